"""What source of compiled slots says means what it means in Python."""

import itertools
import math

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from iout_marl.compiled import llvm, module
from iout_marl.compiled.arrays import GraphLibrary
from iout_marl.compiled.blocks import Store
from iout_marl.compiled.code import Code
from iout_marl.tracing.library import UnknownOperationError

#: Floating numbers, and whole ones, of which all pairs are tried.
REALS = [0.0, -0.0, 1.5, -2.25, 3e-300, math.inf, -math.inf, math.nan]
WHOLE = [0, 1, -1, 7, -12, 2**40]
WORDS = {
    "ZERO": 0.0,
    "ONE": 1.0,
    "select": lambda flag, one, other: one if flag else other,
    "larger": lambda one, other: one if one > other or one != one else other,
    "smaller": lambda one, other: one if one < other or one != one else other,
    "after": lambda one, other: one > other or (one != one and other == other),
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
    found, expected = of_all_pairs(expression, REALS, dtype, dtype)
    np.testing.assert_array_equal(found, expected)
    signed = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found)[signed], np.signbit(expected)[signed])


def test_what_is_no_number_is_as_in_numpy():
    for word, ufunc in (("larger", np.maximum), ("smaller", np.minimum)):
        found, _ = of_all_pairs(f"{word}(a, b)", REALS, "float64", "float64")
        pairs = np.array([(a, b) for a in REALS for b in REALS])
        np.testing.assert_array_equal(found, ufunc(pairs[:, 0], pairs[:, 1]))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_exponentials(dtype):
    found, expected = of_all_pairs("expm1(a)", REALS, dtype, dtype)
    np.testing.assert_allclose(found, expected, rtol=1e-6 if dtype == "float32" else 1e-14)


@pytest.mark.parametrize("compare", ["<", "<=", ">", ">=", "==", "!="])
@pytest.mark.parametrize(("values", "dtype"), [(REALS, "float64"), (WHOLE, "int64")])
def test_comparisons(compare, values, dtype):
    for expression in (
        "after(a, b)",
        f"a {compare} b",
        f"not a {compare} b",
        f"(a {compare} b) & (b > a)",
    ):
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


@pytest.mark.parametrize("operation", ["max", "min", "argmax", "argsort"])
def test_what_is_no_number_in_rows(operation):
    """Of a graph, by way of `Code`, as NumPy does it."""
    rows = np.array(list(itertools.product([0.0, 2.0, -math.inf, math.nan], repeat=4)))
    library = GraphLibrary()
    made = getattr(library, operation)(library.parameter("rows", rows[:1]), axis=-1)
    letter = "i" if operation.startswith("arg") else "f"
    given = {"rows": Store("in_f", 0)}
    code = Code(library.graph, given, [(library.operand(made), Store(f"out_{letter}", 0))])
    compiled = module.module_of(code, "float64", "float64")
    arrays = {name: np.zeros(0, kind) for name, kind in compiled.arrays[: -len("fib")]}
    width = len(rows)
    out = np.zeros((4, width), np.int64 if letter == "i" else np.float64)
    arrays |= {"in_f": np.ascontiguousarray(rows.T), f"out_{letter}": out}
    arrays |= {f"table_{each}": code.tables[each].joined() for each in "fib"}
    module.compiled_function(compiled)(width, width, *map(module.address_of, arrays.values()))
    kind = {"kind": "stable"} if operation == "argsort" else {}
    expected = getattr(np, operation)(rows, axis=-1, **kind)
    found = out.T if operation == "argsort" else out[0]
    np.testing.assert_array_equal(found, expected)


def test_an_array_that_nobody_may_write():
    given, found = np.arange(3.0), np.zeros(1)
    given.flags.writeable = False
    run("put(found, 0, get(given, 2))", given=given, found=found)
    assert found.item() == 2.0


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("put(a, 0, get(a, 0) ** ONE)", KeyError),
        ("put(a, 0, get(a, 0) if True else ONE)", UnknownOperationError),
        ("del a", UnknownOperationError),
        ("put(a, 0, get(a, 0) + 1)", TypeError),
        ("put(a, 0, cosine(ONE))", AttributeError),
        ("put(a, 0, lost)", KeyError),
    ],
)
def test_what_it_does_not_know_is_refused(line, error):
    with pytest.raises(error):
        llvm.Function(line, {"a": "float64"}, (), {}, "float64")


def optimised(lines, **arrays):
    text = llvm.Function(lines, arrays, ("num_envs",), {}, "float64").text()
    return llvm.optimised(text)


def test_lanes_are_played_several_at_a_time():
    """What makes it worth it: LLVM believes that turns have nothing to do with one another."""
    lines = "for {} in range(num_envs):\n    put(b, get(c, {}) * 8 + {}, get(b, {}) * get(a, {}))"
    arrays = {"a": "float64", "b": "float64", "c": "int64"}
    assert "fmul <" in optimised(lines.replace("{}", "lane"), **arrays)
    assert "fmul <" not in optimised(lines.replace("{}", "i0"), **arrays)


def test_arrays_have_no_memory_in_common():
    """LLVM need not look for it."""
    lines = "for i0 in range(num_envs):\n    put({}, i0 + 3, get(a, i0) * ONE)"
    arrays = {"a": "float64", "b": "float64"}
    assert "memcheck" not in optimised(lines.format("b"), **arrays)
    assert "fmul <" in optimised(lines.format("b").replace("* ONE", "* get(a, i0)"), **arrays)
