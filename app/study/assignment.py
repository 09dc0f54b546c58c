"""Assigns conditions, their order and familiarisation videos to a session.

Orders are the rows of a Williams design: every condition comes equally often at every position,
and follows every other condition equally often, so that neither practice nor the trial before
favours one of them.
"""

from collections.abc import Collection, Sequence

import numpy as np

from .plan import Plan


def orders(n: int) -> tuple[tuple[int, ...], ...]:
    """The balanced orders of n conditions: n of them if n is even (or 1), else 2n."""
    if n < 1:
        raise ValueError(f"expected at least one condition, got {n}")
    # 0, 1, n-1, 2, n-2, ...: neighbours differ by 1, -2, 3, ..., each difference modulo n once,
    # which balances who follows whom over the n rotations.
    zigzag = [(step + 1) // 2 if step % 2 else -(step // 2) for step in range(n)]
    square = tuple(tuple((first + row) % n for first in zigzag) for row in range(n))
    if n % 2 == 0 or n == 1:
        return square
    # For odd n the differences pair up unevenly; the mirrored square makes up for it.
    return square + tuple(tuple(reversed(order)) for order in square)


def plan_orders(plan: Plan) -> tuple[tuple[int, ...], ...]:
    """The orders of conditions that sessions of this study are spread over.

    In blocks, the environments take turns, and within each of them its conditions do.
    """
    balanced = plan.order == "counterbalanced"
    if plan.blocks == "session":
        n = len(plan.conditions)
        return orders(n) if balanced else (tuple(range(n)),)
    groups = [
        [index for index, condition in enumerate(plan.conditions) if condition.environment == name]
        for name in plan.used_environments
    ]
    if not balanced:
        return (tuple(index for group in groups for index in group),)
    return tuple(
        tuple(groups[group][place] for group in sequence for place in within)
        for sequence in orders(len(groups))
        for within in orders(len(groups[0]))
    )


def choose_order(counts: Sequence[int], rng: np.random.Generator) -> int:
    """The index of an order that the fewest sessions have; chance decides between equals.

    `counts` holds, for each order, the sessions completed or still active: counting those who
    merely started would let dropouts empty a condition.
    """
    if not counts or min(counts) < 0:
        raise ValueError(f"expected a count of 0 or more for every order, got {list(counts)}")
    fewest = [index for index, count in enumerate(counts) if count == min(counts)]
    return fewest[int(rng.integers(len(fewest)))]


def trial_conditions(plan: Plan, order: Sequence[int]) -> tuple[int, ...]:
    """The index of each trial's condition: a block's order, as often as a condition has trials."""
    if sorted(order) != list(range(len(plan.conditions))):
        expected = f"each of the {len(plan.conditions)} conditions once"
        raise ValueError(f"expected an order with {expected}, got {list(order)}")
    size = len(order) // (len(plan.used_environments) if plan.blocks == "environment" else 1)
    blocks = [tuple(order[start : start + size]) for start in range(0, len(order), size)]
    return tuple(index for block in blocks for index in block * plan.trials_per_condition)


def conditions_on(plan: Plan, off: Collection[str]) -> tuple[int, ...]:
    """The indices of the conditions that are not switched off."""
    return tuple(
        index for index, condition in enumerate(plan.conditions) if condition.name not in off
    )


def narrowed(plan: Plan, conditions: Collection[int]) -> Plan:
    """The plan of a session restricted to these conditions: number of trials and blocks.

    Raises ValueError if none is left, or if blocks of environments would differ in length.
    """
    kept = tuple(plan.conditions[index] for index in sorted(set(conditions)))
    if not kept:
        raise ValueError("expected at least one condition, got none")
    sizes = {
        name: sum(condition.environment == name for condition in kept)
        for name in dict.fromkeys(condition.environment for condition in kept)
    }
    if plan.blocks == "environment" and len(set(sizes.values())) > 1:
        counted = ", ".join(f"{number} in {name}" for name, number in sizes.items())
        raise ValueError(f"expected as many conditions in each environment, got {counted}")
    return (
        plan if len(kept) == len(plan.conditions) else plan.model_copy(update={"conditions": kept})
    )


def sample_familiarisation(n_recordings: int, k: int, rng: np.random.Generator) -> tuple[int, ...]:
    """k random indices of recordings; none is repeated before all have been drawn."""
    if k < 0 or n_recordings < (1 if k else 0):
        raise ValueError(f"expected recordings to draw {k} videos from, got {n_recordings}")
    drawn: list[int] = []
    while len(drawn) < k:
        drawn.extend(int(index) for index in rng.permutation(n_recordings))
    return tuple(drawn[:k])
