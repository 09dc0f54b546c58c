"""A number is taken where it can mean one number; else it is asked back, and never changed."""

import unicodedata
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.numbers import LONGEST, Doubtful, plain, read


@pytest.mark.parametrize(
    ("typed", "stored"),
    [
        ("25", "25"),
        (" 25 ", "25"),
        ("+25", "25"),
        ("-5", "-5"),
        ("\u22125", "-5"),
        ("\uff0d5", "-5"),
        ("25.5", "25.5"),
        ("25,5", "25.5"),
        ("\uff12\uff15", "25"),
        ("\uff17,5", "7.5"),
        ("\uff12\uff15\uff0e\uff15", "25.5"),
        ("\u0662\u0665", "25"),
        ("\u0661\u066b\u0660\u0660\u0660", "1"),
        (".5", "0.5"),
        (",5", "0.5"),
        ("0.500", "0.5"),
        ("0,125", "0.125"),
        ("1,50", "1.5"),
        ("1,2345", "1.2345"),
        ("1234,567", "1234.567"),
        ("1e3", "1000"),
        ("1000", "1000"),
        ("0.1234567890123456789", "0.1234567890123456789"),
        ("12345678901234567890", "12345678901234567890"),
        ("-0", "0"),
    ],
)
def test_what_can_mean_one_number_is_that_number(typed: str, stored: str) -> None:
    number = read(typed)
    assert isinstance(number, Decimal)
    assert plain(number) == stored


@pytest.mark.parametrize(
    ("typed", "readings"),
    [
        ("50,000", ("50000", "50")),
        ("1,000", ("1000", "1")),
        ("1.000", ("1000", "1")),
        ("1.234", ("1234", "1.234")),
        ("-1,500", ("-1500", "-1.5")),
        ("\uff11\uff0c\uff10\uff10\uff10", ("1000", "1")),
        ("\u0661,\u0660\u0660\u0660", ("1000", "1")),
        ("1_000", ("1000",)),
        ("1 000", ("1000",)),
        ("1\u202f000", ("1000",)),
        ("1'000", ("1000",)),
        ("1\u2019000", ("1000",)),
        ("\u0661\u066c\u0660\u0660\u0660", ("1000",)),
        ("1,000,000", ("1000000",)),
        ("1.000.000", ("1000000",)),
        ("1,234.5", ("1234.5",)),
        ("1.234,56", ("1234.56",)),
        ("25%", ("25", "0.25")),
        ("25 \uff05".replace(" ", ""), ("25", "0.25")),
    ],
)
def test_what_could_mean_another_number_is_asked_back(
    typed: str, readings: tuple[str, ...]
) -> None:
    doubtful = read(typed)
    assert isinstance(doubtful, Doubtful)
    assert tuple(map(plain, doubtful.readings)) == readings


@pytest.mark.parametrize(
    "typed",
    [
        *("", " ", "old", "50k", "25 years", "25歳", "inf", "nan", "1e999", "1e-999", "--5", "5-"),
        *("5\u00b2", "\u00bd", "1,2,3", "1,00,000", "1..5", "0x10", "1:30", ".", ",", "-"),
        *("1,000.", "1,000,00", "1 00", "50,000%", "1" * (LONGEST + 1)),
    ],
)
def test_what_is_no_number_is_none(typed: str) -> None:
    assert read(typed) is None


@given(st.integers(-(10**16), 10**16))
def test_a_number_of_four_decimals_comes_back_as_it_was_written(digits: int) -> None:
    number = Decimal(digits) / 10_000
    found = read(f"{number:.4f}")
    assert found == number
    assert Decimal(plain(number)) == number


@given(st.text(alphabet="0123456789.,' _-+eE%\u066b\u066c\uff0c\uff11", max_size=9))
def test_a_text_is_one_number_only_if_its_digits_are_those_that_were_typed(typed: str) -> None:
    number = read(typed)
    if isinstance(number, Decimal) and "e" not in typed.lower():
        said = "".join(c for c in unicodedata.normalize("NFKC", typed) if c.isdigit())
        assert said.strip("0") == "".join(c for c in plain(number) if c.isdigit()).strip("0")
