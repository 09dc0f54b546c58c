"""Linear constraints between parameters, read from text: "w0 >= w1", "0.2 <= x0 + 2 * x1 <= 1.5".

A text is a chain of linear expressions joined by <= or >=. Expressions hold numbers, parameters'
names, +, -, and multiplication or division by a number. The text is parsed as a Python expression
and walked; nothing of it is run.
"""

import ast
from collections.abc import Sequence
from math import isfinite
from typing import Final, NamedTuple

import numpy as np

from .candidates import FloatArray
from .errors import ConstraintError

#: A longer text is no constraint that a person wrote.
LONGEST: Final = 500


class HalfSpaces(NamedTuple):
    """normal @ x <= offset for each of m constraints; normal: (m, d), offset: (m,)."""

    normal: FloatArray
    offset: FloatArray


class Linear(NamedTuple):
    """weights @ x + constant; weights: (d,)."""

    weights: FloatArray
    constant: float


def half_spaces(constraints: Sequence[object], names: Sequence[str]) -> HalfSpaces:
    """All constraints as half-spaces, or `ConstraintError` with the text that is wrong."""
    normals, offsets = [], []
    for text in constraints:
        for less, more in chain_of(text, names):
            weights = less.weights - more.weights
            if not weights.any():
                raise ConstraintError(
                    f"constraint {text!r}: expected a parameter that it bounds, got none"
                )
            normals.append(weights)
            offsets.append(more.constant - less.constant)
    return HalfSpaces(
        np.array(normals, dtype=np.float64).reshape(-1, len(names)), np.array(offsets, dtype=float)
    )


def chain_of(text: object, names: Sequence[str]) -> list[tuple[Linear, Linear]]:
    """The pairs (less, more) of one text, of which the first is at most the second."""
    if not isinstance(text, str):
        raise ConstraintError(f"constraint: expected a text such as 'x0 >= x1', got {text!r}")
    if len(text) > LONGEST:
        raise ConstraintError(
            f"constraint: expected a text of at most {LONGEST} characters, got {len(text)}"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ConstraintError(
            f"constraint {text!r}: expected an inequality such as 'x0 >= x1', got {error}"
        ) from error
    if not isinstance(tree, ast.Compare):
        raise ConstraintError(f"constraint {text!r}: expected <= or >= between two expressions")
    sides = [linear(side, text, names) for side in (tree.left, *tree.comparators)]
    pairs = []
    for operator, one, other in zip(tree.ops, sides, sides[1:], strict=False):
        match operator:
            case ast.LtE():
                pairs.append((one, other))
            case ast.GtE():
                pairs.append((other, one))
            case _:
                raise ConstraintError(f"constraint {text!r}: expected <= or >=, got another sign")
    return pairs


def linear(node: ast.expr, text: str, names: Sequence[str]) -> Linear:  # noqa: PLR0911
    """One side of a constraint as a linear expression."""
    match node:
        case ast.Name(id=name):
            if name not in names:
                raise ConstraintError(
                    f"constraint {text!r}: expected parameters from {', '.join(names)}, "
                    f"got {name!r}"
                )
            return Linear(np.eye(len(names))[list(names).index(name)], 0.0)
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return finite(Linear(np.zeros(len(names)), float(value)), text)
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
            return scaled(
                linear(operand, text, names), -1.0 if isinstance(sign, ast.USub) else 1.0, text
            )
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as sign, right=right):
            one, other = linear(left, text, names), linear(right, text, names)
            other = scaled(other, -1.0 if isinstance(sign, ast.Sub) else 1.0, text)
            return Linear(one.weights + other.weights, one.constant + other.constant)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            one, other = linear(left, text, names), linear(right, text, names)
            if not other.weights.any():
                return scaled(one, other.constant, text)
            if not one.weights.any():
                return scaled(other, one.constant, text)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            one, other = linear(left, text, names), linear(right, text, names)
            if not other.weights.any() and other.constant != 0.0:
                return scaled(one, 1.0 / other.constant, text)
    raise ConstraintError(
        f"constraint {text!r}: expected linear expressions of {', '.join(names)}, "
        f"got {ast.unparse(node)!r}"
    )


def scaled(expression: Linear, factor: float, text: str) -> Linear:
    """The expression times a number."""
    return finite(Linear(factor * expression.weights, factor * expression.constant), text)


def finite(expression: Linear, text: str) -> Linear:
    """The expression itself, or `ConstraintError` if a number in it is not finite."""
    if not (np.isfinite(expression.weights).all() and isfinite(expression.constant)):
        raise ConstraintError(f"constraint {text!r}: expected finite numbers")
    return expression
