"""Checks at the boundary and the errors they raise."""

from __future__ import annotations

import inspect
import math
import pickle
from decimal import Decimal

import numpy as np
import pytest

from antway import check_episode, check_motion, check_plan, check_tour, check_tsptw, checks, errors, make_policy

NO_NUMBERS = [True, np.True_, "1", None, math.nan, math.inf, -math.inf, 1j, [1.0], np.float64("nan"), 10**400, Decimal("NaN")]
NO_NUMBERS += [np.complex64(1 + 2j), np.array(5.0)]


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_number(value: object) -> None:
    """Booleans, texts, None, NaN, infinities and huge integers are no numbers; the error holds name, value and range."""
    with pytest.raises(errors.BadParameter) as caught:
        checks.number("radius", value, low=0.0, high=2.0, unit="m")
    assert caught.value.field == "radius" and caught.value.value is value
    assert "[0, 2] (m)" in str(caught.value)


def test_ends_of_ranges() -> None:
    """Ends of a range belong to it but for an open lower one; infinity only where allowed."""
    assert checks.number("a", np.float32(2), low=2, high=2) == 2.0
    assert math.copysign(1, checks.number("a", -0.0, low=0)) == -1
    assert checks.number("a", math.inf, infinite=True) == math.inf
    for wrong in ({"value": 0.0, "low": 0.0, "open_low": True}, {"value": 3, "high": 2.9}):
        with pytest.raises(errors.BadParameter):
            checks.number("a", **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [True, 1.0, "1", None, math.nan, np.float64(1), -1, 11])
def test_what_is_no_integer(value: object) -> None:
    """Only integers in range are integers."""
    with pytest.raises(errors.BadParameter):
        checks.integer("ants", value, low=0, high=10)


def test_integers_and_seeds() -> None:
    """NumPy's integers become Python's; a seed has 64 bits and no sign."""
    assert type(checks.integer("a", np.int8(5))) is int
    for wrong in (-(2**63) - 1, 2**63):
        with pytest.raises(errors.BadParameter, match=r"\[-9223372036854775808, 9223372036854775807\]"):
            checks.integer("a", wrong)
    with pytest.raises(errors.BadParameter, match=r"\[0, 4294967295\]"):
        checks.integer("seed", -1, low=0, high=2**32 - 1)
    assert checks.seed(2**64 - 1) == 2**64 - 1
    for wrong in (-1, 2**64, 0.0):
        with pytest.raises(errors.BadParameter):
            checks.seed(wrong)


def test_an_objective_may_have_a_hyphen() -> None:
    """Python takes the name of the command line as well."""
    assert [checks.objective(name) for name in ("travel-time", "travel time", "makespan")] == ["travel time"] * 2 + ["makespan"]
    for wrong in ("length", None, ["travel-time"]):
        with pytest.raises(errors.BadParameter, match="objective"):
            checks.objective(wrong)


def test_points_arrays_choices_instances() -> None:
    """Each check gives the value in its type or an error of the kind asked for."""
    assert checks.point("xy", np.array([1, 2])) == (1.0, 2.0)
    for wrong in ("12", b"12", {1: 2, 3: 4}, {1, 2}, frozenset((1, 2)), (1,), (1, math.nan), 5, (1, "2"), np.array(5.0)):
        with pytest.raises(errors.BadParameter):
            checks.point("xy", wrong)
    assert checks.sequence("s", [[1, 2], [3]], "numbers") == [[1, 2], [3]], "ragged ones too"
    array = checks.array("a", [[1, 2]], (None, 2))
    assert array.dtype == np.float64 and not array.flags.writeable
    for wrong, shape in (
        ([[1, 2]], (2, 2)),
        ([1.0, math.nan], (2,)),
        ([[1], [1, 2]], (None, None)),
        ("x", (1,)),
        ([10**400], (1,)),
        (np.ones(1, dtype=complex), (1,)),
    ):
        with pytest.raises(errors.BadParameter):
            checks.array("a", wrong, shape)
    with pytest.raises(errors.BadParameter, match=r"must be \(earliest, latest\) in s$"):
        checks.window("window", None)
    assert checks.choice("c", "b", "ab") == "b"
    assert checks.instance("i", 3, int) == 3
    for check, arguments in (
        (checks.choice, ("c", 3, "ab")),
        (checks.choice, ("c", "z", "ab")),
        (checks.instance, ("i", "3", int)),
    ):
        with pytest.raises(errors.BadParameter):
            check(*arguments)  # type: ignore[operator]


@pytest.mark.parametrize("kind", [k for k in vars(errors).values() if isinstance(k, type) and issubclass(k, errors.BadInput)])
def test_bad_input_survives_pickling(kind: type[errors.BadInput]) -> None:
    """Each `BadInput` crosses processes whole, says where, and shortens a long value; it is a `ValueError`."""
    error = kind("field", "x" * 500, "short", where="a.yaml")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind and vars(again) == vars(error) and str(again) == str(error)
    assert str(error).startswith("a.yaml: field = 'xxx") and len(str(error)) < 140
    assert isinstance(error, ValueError) and isinstance(error, errors.AntwayError)


def test_invalid_plan_survives_pickling() -> None:
    """An `InvalidPlan` crosses processes with every violation."""
    error = errors.InvalidPlan(["jumps", "leaves"])
    assert pickle.loads(pickle.dumps(error)).violations == ("jumps", "leaves")
    assert str(error) == "jumps; leaves"


@pytest.mark.parametrize("check", [check_episode, check_motion, check_plan, check_tour, check_tsptw])
def test_verifiers_name_what_is_of_another_kind(check) -> None:
    needed = [one for one in inspect.signature(check).parameters.values() if one.default is one.empty]
    with pytest.raises(errors.BadParameter):
        check(*(object() for _ in needed))


@pytest.mark.parametrize(("policy", "option"), [("dwa", "horizon"), ("mppi", "block"), ("potential-field", "conic")])
def test_options_of_baselines_are_refused_before_they_overflow(policy: str, option: str) -> None:
    """They were taken, and ended the episode by an OverflowError."""
    with pytest.raises(errors.BadParameter, match=f"{option} = 1e.308"):
        make_policy(policy, **{option: 1e308})


def test_messages_are_of_one_line() -> None:
    """Also where the value is an array, whose text has several."""
    assert "\n" not in str(errors.BadParameter("goal", np.zeros((3, 2)), "a cell"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: checks.number("a", "x"), "a = 'x': must be a finite number"),
        (lambda: checks.number("a", -1, low=0.0, unit="m"), "a = -1: must be a finite number >= 0 (m)"),
        (lambda: checks.number("a", 0, low=0.0, open_low=True, infinite=True), "a = 0: must be a number > 0"),
        (lambda: checks.number("a", 6, high=5.5), "a = 6: must be a finite number <= 5.5"),
        (lambda: checks.number("a", 6, low=0.0, high=5.0, open_low=True), "a = 6: must be a finite number in (0, 5]"),
        (lambda: checks.integer("a", 1.5), "a = 1.5: must be an integer"),
        (lambda: checks.integer("a", 0, low=1), "a = 0: must be an integer >= 1"),
        (lambda: checks.integer("a", 0, low=1, high=3), "a = 0: must be an integer in [1, 3]"),
        (lambda: checks.integer("a", 2**63), f"a = {2**63}: must be an integer in [{-(2**63)}, {2**63 - 1}]"),
        (lambda: checks.number("a", 10**5000), "a = <int>: must be a finite number"),  # Python prints up to 4300 digits
        (lambda: checks.array("a", np.zeros((2, 2)), (None,)), "a.shape = (2, 2): must be N"),
        (lambda: checks.array("a", np.zeros(2), (None, 2)), "a.shape = (2,): must be Nx2"),
        (lambda: checks.point("a", (1.0, math.nan), where="here"), "here: a[1] = nan: must be a finite number"),
        (lambda: checks.window("a", (0.0, "b")), "a = 'b': must be a number (s)"),
        (lambda: checks.window("a", (-3.0, -2.0)), "a = (-3.0, -2.0): must be an earliest time"),
    ],
)
def test_messages_say_what_is_allowed(call, message: str) -> None:
    with pytest.raises(errors.BadParameter) as caught:
        call()
    assert str(caught.value).startswith(message)
    assert checks.window("a", (-3.0, math.inf)) == (0.0, math.inf)
