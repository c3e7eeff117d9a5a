from itertools import islice

from hypothesis import given
from hypothesis import strategies as st

from slamgym.dataset.schedule import Slot, exploration_seed, ids_digest, schedule

IDS = [f"plan{i}" for i in range(7)]


def test_every_plan_comes_once_in_each_round():
    slots = list(islice(schedule(IDS, seed=3), 21))
    for repetition in range(3):
        turn = slots[7 * repetition : 7 * repetition + 7]
        assert {slot.plan_id for slot in turn} == set(IDS)
        assert {slot.repetition for slot in turn} == {repetition}
    assert [slot.index for slot in slots] == list(range(21))


def test_repetitions_and_plans_get_seeds_of_their_own():
    slots = list(islice(schedule(IDS, seed=3), 70))
    assert len({slot.seed for slot in slots}) == 70


def test_the_order_is_shuffled_by_the_seed_alone():
    first = [slot.plan_id for slot in islice(schedule(IDS, seed=1), 7)]
    assert first == [slot.plan_id for slot in islice(schedule(IDS, seed=1), 7)]
    assert any(first != [slot.plan_id for slot in islice(schedule(IDS, seed=s), 7)] for s in range(2, 6))


@given(st.integers(min_value=0), st.text(), st.integers(0, 10**6))
def test_seeds_fit_a_signed_64_bit_integer(seed, plan_id, repetition):
    value = exploration_seed(seed, plan_id, repetition)
    assert 0 <= value < 2**63
    assert value == exploration_seed(seed, plan_id, repetition)


@given(st.text(min_size=1))
def test_names_are_safe_file_names(plan_id):
    name = Slot(12, plan_id, 0, 0).name
    assert name.startswith("000012_")
    assert "/" not in name
    assert name.isascii()


def test_a_changed_plan_list_has_another_digest():
    assert ids_digest(IDS) == ids_digest(list(IDS))
    assert len({ids_digest(IDS), ids_digest(IDS[::-1]), ids_digest(IDS[1:]), ids_digest(["plan0plan1"])}) == 4
