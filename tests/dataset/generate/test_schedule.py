from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.cad import PlanGroup, open_plans, plan_groups
from slamgym.core.names import exploration_seed
from slamgym.dataset.generate.build import schedule_groups
from slamgym.dataset.record import Slot

IDS = [f"plan{i}" for i in range(7)]


def schedule(plan_ids, seed, trajectories=1):
    """The explorations of one source."""
    return schedule_groups([PlanGroup(plan_ids, 1.0)], seed, trajectories)


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
    assert any(
        first != [slot.plan_id for slot in islice(schedule(IDS, seed=s), 7)] for s in range(2, 6)
    )


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


@given(st.lists(st.integers(1, 9), min_size=1, max_size=4), st.integers(1, 3), st.integers(0, 99))
def test_every_beginning_has_the_proportions_of_the_weights(weights, trajectories, seed):
    groups = [PlanGroup([f"{n}/{i}" for i in range(5)], float(w)) for n, w in enumerate(weights)]
    slots = list(islice(schedule_groups(groups, seed, trajectories), 40 * trajectories))
    plans = [slot.plan_id for slot in slots[::trajectories]]
    for length in (5, 17, 40):
        for number, weight in enumerate(weights):
            count = sum(plan_id.startswith(f"{number}/") for plan_id in plans[:length])
            # Taking turns keeps every count within one turn per other source of its share.
            assert abs(count - length * weight / sum(weights)) < len(weights)


def test_explorations_of_one_plan_follow_each_other_and_differ():
    slots = list(islice(schedule(IDS, seed=3, trajectories=2), 28))
    for first, second in zip(slots[::2], slots[1::2], strict=True):
        assert first.plan_id == second.plan_id
        assert second.repetition == first.repetition + 1
        assert first.seed != second.seed
    of_one = [slot for slot in slots if slot.plan_id == IDS[0]]
    assert [slot.repetition for slot in of_one] == [0, 1, 2, 3]
    single = {(s.plan_id, s.repetition): s.seed for s in islice(schedule(IDS, seed=3), 28)}
    assert {(s.plan_id, s.repetition): s.seed for s in slots} == single


@pytest.mark.parametrize("seed", range(5))
def test_the_bundled_plans_begin_with_homes_and_hide_no_office(seed):
    slots = islice(schedule_groups(plan_groups(open_plans("bundled")), seed), 24)
    assert "".join(slot.plan_id[0] for slot in slots) == "hhoh" * 6


def test_a_source_has_the_same_order_whatever_stands_beside_it():
    alone = [slot.plan_id for slot in islice(schedule(IDS, seed=3), 7)]
    groups = [PlanGroup(IDS, 1.0), PlanGroup(["x", "y"], 3.0)]
    mixed = [slot.plan_id for slot in islice(schedule_groups(groups, seed=3), 28)]
    assert [plan_id for plan_id in mixed if plan_id in IDS] == alone
