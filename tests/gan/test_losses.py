"""Every term by hand, and that every sample and every scale gets a gradient."""

import math

import pytest
import torch

from slamgym.gan.training import losses


def features(*copies):
    """Copies of a discriminator: each a list of values, one feature map each."""
    return [[torch.as_tensor(v, dtype=torch.float32) for v in copy] for copy in copies]


def test_adversarial_loss_by_hand():
    scores = torch.tensor([0.0, 2.0])
    assert float(losses.adversarial_loss(scores, True)) == pytest.approx(1.0)  # (1 + 1) / 2
    assert float(losses.adversarial_loss(scores, False)) == pytest.approx(2.0)  # (0 + 4) / 2


def test_a_discriminators_loss_is_the_mean_of_right_wrong_and_unassociated():
    real, fake, other = (
        features([[3.0]], [[1.0]]),
        features([[1.0]], [[0.0]]),
        features([[2.0]], [[2.0]]),
    )
    # Sums over the copies: 4 + 0, 1 + 0, 4 + 4.
    assert float(losses.discriminator_loss(real, [fake, other])) == pytest.approx(
        (4.0 + 1.0 + 8.0) / 3
    )
    assert float(losses.discriminator_loss(real, [fake])) == pytest.approx((4.0 + 1.0) / 2)


def test_generator_terms_sum_over_the_copies():
    fake = features([[9.0], [0.0]], [[9.0], [3.0]])
    assert float(losses.taken_for_real_loss(fake)) == 1.0 + 4.0


def test_every_sample_and_every_scale_gets_a_gradient():
    scores = [
        torch.zeros(4, 1, 1, 1, requires_grad=True),
        torch.zeros(4, 1, 3, 3, requires_grad=True),
    ]
    losses.taken_for_real_loss([[s] for s in scores]).backward()
    for score in scores:
        per_sample = score.grad.abs().sum(dim=(1, 2, 3))
        assert (per_sample > 0.0).all()
        assert torch.allclose(per_sample, per_sample[:1].expand(4))


def test_feature_matching_weighs_layers_and_leaves_the_score_out(monkeypatch):
    fake, real = (
        features([[1.0], [1.0], [50.0]], [[4.0], [0.0]]),
        features([[0.0], [3.0], [0.0]], [[2.0], [0.0]]),
    )
    # First copy 5 * 1 + 2 * 2, second 5 * 2; what comes after the weights is dropped.
    for weights, expected in (((5.0, 2.0), 9.0 + 10.0), ((5.0,), 5.0 + 10.0)):
        monkeypatch.setattr(losses, "LAYER_WEIGHTS", weights)
        assert float(losses.feature_matching_loss(fake, real)) == pytest.approx(expected)


def test_references_are_constants():
    fake, real = torch.ones(2, requires_grad=True), torch.zeros(2, requires_grad=True)
    losses.feature_matching_loss([[fake, fake]], [[real, real]]).backward()
    assert fake.grad is not None
    assert real.grad is None


def log_loss(score, real):
    """-log D or -log(1 - D) of D = sigmoid(score), by hand."""
    chance = 1.0 / (1.0 + math.exp(-score))
    return -math.log(chance if real else 1.0 - chance)


@pytest.mark.parametrize("real", [True, False])
def test_printed_adversarial_loss_by_hand(real):
    found = losses.adversarial_loss(torch.tensor([0.5, -2.0]), real, "printed")
    expected = 0.5 * (log_loss(0.5, real) + log_loss(-2.0, real))
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_equation_2_as_printed_sums_the_three_kinds_of_pairs_over_the_copies():
    real = features([[3.0], [1.0]], [[0.0], [2.0]])
    fake = features([[1.0], [-1.0]], [[0.0], [0.5]])
    other = features([[2.0], [0.3]], [[0.0], [-3.0]])
    expected = log_loss(1.0, True) + log_loss(2.0, True)
    expected += log_loss(-1.0, False) + log_loss(0.5, False)
    expected += log_loss(0.3, False) + log_loss(-3.0, False)
    found = losses.discriminator_loss(real, [fake, other], "printed")
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_equation_3_as_printed_sums_right_and_drawn_images():
    real, fake = features([[1.5]]), features([[-0.5]])
    expected = log_loss(1.5, True) + log_loss(-0.5, False)
    assert float(losses.discriminator_loss(real, [fake], "printed")) == pytest.approx(expected)
    # The generator wants the opposite for what it draws, and better drawings lower its loss.
    assert float(losses.taken_for_real_loss(fake, "printed")) == pytest.approx(log_loss(-0.5, True))
    better = losses.taken_for_real_loss(features([[0.5]]), "printed")
    assert float(better) < log_loss(-0.5, True)


def test_equations_4_and_5_as_printed_take_all_layers_alike():
    fake = features([[1.0, 2.0], [1.0], [50.0]], [[4.0, 4.0, 4.0, 7.0], [0.0]])
    real = features([[0.0, 5.0], [3.0], [0.0]], [[2.0, 2.0, 2.0, 2.0], [0.5]])
    # 1 / N_i of the sums: (1 + 3) / 2 + 2 + 50, and (2 + 2 + 2 + 5) / 4 + 0.5.
    expected = 2.0 + 2.0 + 50.0 + 2.75 + 0.5
    assert float(losses.feature_matching_loss(fake, real, "printed")) == pytest.approx(expected)


def test_more_layers_than_weights_all_pass_a_gradient_as_printed():
    layers_of = [torch.ones(3, requires_grad=True) for _ in range(9)]
    constants = [torch.zeros(3) for _ in range(9)]
    losses.feature_matching_loss([layers_of], [constants], "printed").backward()
    for layer in layers_of:
        assert layer.grad.tolist() == pytest.approx([1.0 / 3.0] * 3)


def test_l1_by_hand():
    assert float(losses.l1_loss(torch.tensor([1.0, -1.0]), torch.tensor([1.0, 0.0]))) == 0.5


def layers(floor):
    """Floor (B, 1, H, W) in [0, 1], and the rest wall, as layers in [-1, 1]."""
    nothing = torch.zeros_like(floor)
    return 2.0 * torch.cat([floor, 1.0 - floor, nothing, nothing], dim=1) - 1.0


def test_cross_entropy_by_hand():
    logits = torch.zeros(1, 4, 4, 4)
    logits[:, 0] = 1.0
    expected = math.log(3.0 + math.e) - 1.0
    found = losses.cross_entropy_loss(logits, layers(torch.ones(1, 1, 4, 4)))
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_cross_entropy_of_the_shares_themselves_is_least():
    floor = torch.full((1, 1, 4, 4), 0.25)
    target = layers(floor)
    right = torch.log(losses.probabilities(target) + 1e-9)
    entropy = -(0.25 * math.log(0.25) + 0.75 * math.log(0.75))
    assert float(losses.cross_entropy_loss(right, target)) == pytest.approx(entropy, rel=1e-4)
    assert float(losses.cross_entropy_loss(torch.zeros_like(right), target)) > entropy


def test_borders_weigh_more():
    floor = torch.zeros(1, 1, 8, 8)
    floor[..., 4:] = 1.0
    near = losses.near_borders(floor)
    assert near[0, 0, 0].tolist() == [0, 0, 1, 1, 1, 1, 0, 0]
    wrong = []
    for column in (0, 3):  # far from the border, and at it
        logits = torch.zeros(1, 4, 8, 8)
        logits[:, 0, :, column] = 5.0
        wrong.append(float(losses.cross_entropy_loss(logits, layers(floor))))
    assert wrong[1] > wrong[0]


def test_dice_is_zero_for_the_target_and_near_one_for_its_opposite():
    floor = torch.ones(2, 1, 16, 16)
    floor[..., :8] = 0.0
    target = layers(floor)
    assert float(losses.dice_loss(target, target)) == pytest.approx(0.0, abs=1e-6)
    assert float(losses.dice_loss(layers(1.0 - floor), target)) == pytest.approx(1.0, abs=0.01)
    as_door = target[:, [2, 1, 0, 3]]
    assert float(losses.dice_loss(as_door, target)) == pytest.approx(0.0, abs=1e-6)


def test_thin_walls_and_the_floor_beside_them_weigh_more(monkeypatch):
    floor = torch.zeros(1, 1, 40, 60)
    floor[..., 5:35, 5:55] = 1.0
    floor[..., 5:20, 28:31] = 0.0  # a wall of three pixels, open at its lower end
    near = losses.near_thin_walls(floor)
    assert near[0, 0, 10, 26:33].tolist() == [1.0] * 7
    assert float(near[0, 0, 10, 25]) == float(near[0, 0, 30, 29]) == 0.0
    assert (
        float(near[..., :3, :].sum()) == float(near[..., :4].sum()) == 0.0
    )  # outer walls are thick
    hole, bulge = floor.clone(), floor.clone()
    hole[..., 10:12, 28:31] = 1.0  # in the thin wall
    bulge[..., 35:37, 28:31] = 1.0  # as large, of the outline
    for weight, ratio in ((0.0, 1.0), (3.0, 7.0 / 4.0)):  # beside 1 and the border's 3
        monkeypatch.setattr(losses, "WALL_WEIGHT", weight)
        right, with_hole, with_bulge = (
            float(losses.cross_entropy_loss(3.0 * layers(drawn), layers(floor)))
            for drawn in (floor, hole, bulge)
        )
        assert (with_hole - right) / (with_bulge - right) == pytest.approx(ratio, rel=0.01)
