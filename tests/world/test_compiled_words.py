"""What source of compiled slots says means what it means in Python."""

import math

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from iout_marl.compiled import llvm, module

#: Floating numbers, and whole ones, of which all pairs are tried.
REALS = [0.0, -0.0, 1.5, -2.25, 3e-300, math.inf, -math.inf, math.nan]
WHOLE = [0, 1, -1, 7, -12, 2**40]
WORDS = {
    "ZERO": 0.0,
    "ONE": 1.0,
    "select": lambda flag, one, other: one if flag else other,
    "larger": lambda one, other: max(other, one),
    "smaller": lambda one, other: min(other, one),
    "sqrt": np.sqrt,
    "expm1": np.expm1,
    "real": float,
    "int": int,
}


def run(lines, dtype="float64", lanes=0, **arrays):
    """Run source on arrays."""
    kinds = tuple((name, array.dtype.name) for name, array in arrays.items())
    made = module.Module(lines, kinds, (), 8, dtype)
    module.compiled_function(made)(lanes, 1, *map(module.address_of, arrays.values()))


def of_all_pairs(expression, values, result, dtype):
    """What an expression of `a` and `b` is for all pairs of values, compiled and in Python."""
    pairs = np.array([(a, b) for a in values for b in values], dtype)
    found, count = np.zeros(len(pairs), result), len(pairs)
    lines = (
        f"for lane in range({count}):\n"
        "    a = get(pairs, 2 * lane)\n"
        "    b = get(pairs, 2 * lane + 1)\n"
        f"    put(found, lane, {expression})"
    )
    run(lines, dtype if dtype != "int64" else "float64", pairs=pairs, found=found)
    with np.errstate(all="ignore"):
        expected = [eval(expression, WORDS | {"a": a, "b": b}) for a, b in pairs]
        return found, np.array(expected).astype(result)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    "expression",
    [
        *("a + b", "a - b", "a * b", "a / b", "-a", "a * a"),
        *("larger(a, b)", "smaller(a, b)", "select(a < b, a, b)", "select(a == b, ZERO, ONE)"),
        *("sqrt(a)", "real(a)"),
    ],
)
def test_floating_numbers(expression, dtype):
    np.testing.assert_array_equal(*of_all_pairs(expression, REALS, dtype, dtype))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_exponentials(dtype):
    found, expected = of_all_pairs("expm1(a)", REALS, dtype, dtype)
    np.testing.assert_allclose(found, expected, rtol=1e-6 if dtype == "float32" else 1e-14)


@pytest.mark.parametrize("compare", ["<", "<=", ">", ">=", "==", "!="])
@pytest.mark.parametrize(("values", "dtype"), [(REALS, "float64"), (WHOLE, "int64")])
def test_comparisons(compare, values, dtype):
    for expression in (f"a {compare} b", f"not a {compare} b", f"(a {compare} b) & (b > a)"):
        np.testing.assert_array_equal(*of_all_pairs(expression, values, "bool", dtype))


@pytest.mark.parametrize(
    "expression",
    ["a + b", "a - b", "a * 3", "-a", "larger(a, b)", "smaller(a, b)", "select(a > b, 1, 0)"],
)
def test_whole_numbers(expression):
    np.testing.assert_array_equal(*of_all_pairs(expression, WHOLE, "int64", "int64"))


def test_numbers_of_one_kind_as_another():
    np.testing.assert_array_equal(*of_all_pairs("real(a)", WHOLE, "float64", "int64"))
    values = [0.0, 1.9, -1.9, 1e9]
    np.testing.assert_array_equal(*of_all_pairs("int(a)", values, "int64", "float64"))
    # As observations are: of another type than the world's numbers.
    np.testing.assert_array_equal(*of_all_pairs("a * b", values, "float32", "float64"))
    np.testing.assert_array_equal(*of_all_pairs("a * b", values, "float64", "float32"))


def test_flags_in_memory():
    flags = np.array([True, False, True, True])
    run("for i0 in range(2):\n    put(f, i0, get(f, 2 * i0) & get(f, 2 * i0 + 1))", f=flags)
    assert flags.tolist() == [False, True, True, True]


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 100])
def test_loops_in_loops(count):
    made, expected = np.zeros(3 * 100), np.zeros((3, 100))
    run(
        "for base in range(0, num_envs, TILE):\n"
        "    lanes = smaller(TILE, num_envs - base)\n"
        "    for i0 in range(3):\n"
        "        for lane in range(lanes):\n"
        "            put(made, i0 * 100 + base + lane, real(i0 * 1000 + base + lane))",
        lanes=count,
        made=made,
    )
    expected[:, :count] = np.arange(3)[:, None] * 1000 + np.arange(count)
    np.testing.assert_array_equal(made.reshape(3, 100), expected)


def test_a_loop_within_lanes():
    """By insertion, as `argsort` is."""
    rng = np.random.default_rng(0)
    values, order = rng.integers(0, 4, (6, 5)).astype(float), np.zeros((6, 5), np.int64)
    run(
        "for lane in range(6):\n"
        "    for j in range(5):\n"
        "        v = get(values, lane * 5 + j)\n"
        "        k = j\n"
        "        while k > 0 and get(values, lane * 5 + get(order, lane * 5 + k - 1)) > v:\n"
        "            put(order, lane * 5 + k, get(order, lane * 5 + k - 1))\n"
        "            k -= 1\n"
        "        put(order, lane * 5 + k, j)",
        values=values,
        order=order,
    )
    np.testing.assert_array_equal(order, np.argsort(values, axis=1, kind="stable"))


def test_an_array_that_nobody_may_write():
    given, found = np.arange(3.0), np.zeros(1)
    given.flags.writeable = False
    run("put(found, 0, get(given, 2))", given=given, found=found)
    assert found.item() == 2.0


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("put(a, 0, get(a, 0) ** ONE)", KeyError),
        ("put(a, 0, get(a, 0) if True else ONE)", NotImplementedError),
        ("del a", NotImplementedError),
        ("put(a, 0, get(a, 0) + 1)", TypeError),
        ("put(a, 0, cosine(ONE))", AttributeError),
        ("put(a, 0, lost)", KeyError),
    ],
)
def test_what_it_does_not_know_is_refused(line, error):
    with pytest.raises(error):
        llvm.Function(line, {"a": "float64"}, (), {}, "float64")


def test_lanes_are_played_several_at_a_time():
    """What makes it worth it: LLVM believes that turns have nothing to do with one another."""
    lines = "for lane in range(num_envs):\n    put(b, lane + num_envs, get(b, lane) * get(a, lane))"
    text = llvm.Function(lines, {"a": "float64", "b": "float64"}, ("num_envs",), {}, "float64")
    assert "fmul <" in llvm.optimised(text.text())
