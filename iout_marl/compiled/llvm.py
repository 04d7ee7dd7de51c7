"""Source of loops, in the few words of Python that `Code` knows, as machine code by LLVM.

Whoever writes the source says of each loop what a compiler could not know: turns over `lane` have
nothing to do with one another, and arrays have no memory in common. So LLVM plays several lanes by
one instruction. It may not reorder operations on floating numbers.
"""

from __future__ import annotations

import ast
import ctypes
import ctypes.util
import functools
import re
import sys
from collections.abc import Mapping
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from iout_marl.tracing.library import UnknownOperationError

#: Type of addresses, counts and whole numbers; of flags, and of these in memory.
_INT, _FLAG, _BYTE = ir.IntType(64), ir.IntType(1), ir.IntType(8)
#: Types of numbers in memory, by the names of NumPy's.
_IN_MEMORY = {
    "float32": ir.FloatType(),
    "float64": ir.DoubleType(),
    "int64": _INT,
    "bool": _BYTE,
}
_REALS = (ir.FloatType, ir.DoubleType)
_COMPARED = {ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
#: Operations of two numbers: on floating ones, on whole ones or flags.
_OPERATIONS = {
    ast.Add: ("fadd", "add"),
    ast.Sub: ("fsub", "sub"),
    ast.Mult: ("fmul", "mul"),
    ast.Div: ("fdiv", None),
    ast.BitAnd: (None, "and_"),
    ast.BitOr: (None, "or_"),
}
NAME = "slots"


class Function:
    """A function of LLVM, of lines of source.

    Args:
        source: the lines.
        arrays: the type of each array's numbers, by name, as NumPy calls it.
        numbers: names of whole numbers that come before the arrays.
        constants: whole numbers by name.
        dtype: of floating numbers.
    """

    def __init__(
        self,
        source: str,
        arrays: Mapping[str, str],
        numbers: tuple[str, ...],
        constants: Mapping[str, int],
        dtype: str,
    ) -> None:
        self.module = ir.Module(NAME)
        self._real = _IN_MEMORY[dtype]
        pointers = [ir.PointerType()] * len(arrays)
        form = ir.FunctionType(ir.VoidType(), [*([_INT] * len(numbers)), *pointers])
        self._function = ir.Function(self.module, form, NAME)
        given = dict(zip([*numbers, *arrays], self._function.args, strict=True))
        #: Addresses of arrays, and types of their numbers.
        self._arrays = {name: (given[name], _IN_MEMORY[kind]) for name, kind in arrays.items()}
        for pointer, _ in self._arrays.values():
            pointer.add_attribute("noalias")
        self._entry = self._function.append_basic_block("entry")
        self._builder = ir.IRBuilder(self._function.append_basic_block("start"))
        self._values: dict[str, Any] = {
            **{name: given[name] for name in numbers},
            **{name: _INT(value) for name, value in constants.items()},
            "ZERO": self._real(0.0),
            "ONE": self._real(1.0),
        }
        #: Where variables are, which LLVM makes registers of, and their types.
        self._places: dict[str, tuple[Any, Any]] = {}
        #: Marks accesses of turns that have nothing to do with one another.
        self._apart: Any = None
        self._run(ast.parse(source).body)
        self._builder.ret_void()
        ir.IRBuilder(self._entry).branch(self._function.blocks[1])

    # Statements.

    def _run(self, statements: list[ast.stmt]) -> None:
        for statement in statements:
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self._assign(name, self._value(value))
                case ast.AugAssign(target=ast.Name(id=name), op=operation, value=value):
                    both = self._value(ast.Name(name)), self._value(value)
                    self._assign(name, self._operated(type(operation), *both))
                case ast.Expr(ast.Call(func=ast.Name("put"), args=[array, place, value])):
                    self._put(array, place, value)
                case ast.For(target=ast.Name(id=name), iter=ast.Call(args=bounds), body=body):
                    self._for(name, [self._value(bound) for bound in bounds], body)
                case ast.While(test=test, body=body):
                    self._while(test, body)
                case _:
                    raise UnknownOperationError(ast.unparse(statement))

    def _assign(self, name: str, value: Any) -> None:
        if name not in self._places:
            start = ir.IRBuilder(self._entry)
            self._places[name] = start.alloca(value.type, name=name), value.type
        self._builder.store(value, self._places[name][0])

    def _for(self, name: str, bounds: list[Any], body: list[ast.stmt]) -> None:
        """A loop from the first number to before the next one by the last; of one, from 0 by 1."""
        builder = self._builder
        first, end, step = bounds if len(bounds) == 3 else [_INT(0), *bounds, _INT(1)]
        before = builder.block
        inside, after = (builder.append_basic_block(f"{name}_{at}") for at in ("turn", "end"))
        builder.cbranch(builder.icmp_signed("<", first, end), inside, after)
        builder.position_at_end(inside)
        turn = builder.phi(_INT, name)
        turn.add_incoming(first, before)
        self._values[name] = turn
        outer = self._apart
        if name == "lane":
            self._apart = self._distinct("access")
        self._run(body)
        more = builder.add(turn, step, flags=("nsw", "nuw"))
        turn.add_incoming(more, builder.block)
        latch = builder.cbranch(builder.icmp_signed("<", more, end), inside, after)
        if name == "lane":
            latch.set_metadata("llvm.loop", self._lanes_loop())
        self._apart = outer
        builder.position_at_end(after)

    def _lanes_loop(self) -> Any:
        apart = self.module.add_metadata(["llvm.loop.parallel_accesses", self._apart])
        return self._distinct("loop", apart)

    def _distinct(self, kind: str, *parts: Any) -> Any:
        """Metadata that is like no other, which `text` writes out."""
        own = _INT(len(self.module.metadata))
        return self.module.add_metadata([kind, own, *parts])

    def text(self) -> str:
        """The module in LLVM's language."""
        text = re.sub(r'= !{ !"access", [^}]*}', "= distinct !{}", str(self.module))
        return re.sub(r'(!\d+) = !{ !"loop", i64 \d+, ', r"\1 = distinct !{ \1, ", text)

    def _while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        builder = self._builder
        asked, inside, after = (
            builder.append_basic_block(f"while_{at}") for at in ("test", "turn", "end")
        )
        builder.branch(asked)
        builder.position_at_end(asked)
        parts = test.values if isinstance(test, ast.BoolOp) else [test]
        for part in parts[:-1]:
            further = builder.append_basic_block("while_and")
            builder.cbranch(self._value(part), further, after)
            builder.position_at_end(further)
        builder.cbranch(self._value(parts[-1]), inside, after)
        builder.position_at_end(inside)
        self._run(body)
        builder.branch(asked)
        builder.position_at_end(after)

    def _put(self, array: ast.expr, place: ast.expr, value: ast.expr) -> None:
        address, kind = self._address(array, place)
        number = self._value(value)
        if kind == _BYTE:
            number = self._builder.zext(number, _BYTE)
        elif isinstance(kind, ir.FloatType) and isinstance(number.type, ir.DoubleType):
            number = self._builder.fptrunc(number, kind)
        elif isinstance(kind, ir.DoubleType) and isinstance(number.type, ir.FloatType):
            number = self._builder.fpext(number, kind)
        self._mark(self._builder.store(number, address))

    def _address(self, array: ast.expr, place: ast.expr) -> tuple[Any, Any]:
        """Where a number of an array is, and its type."""
        assert isinstance(array, ast.Name)
        pointer, kind = self._arrays[array.id]
        at = [self._value(place)]
        return self._builder.gep(pointer, at, inbounds=True, source_etype=kind), kind

    def _mark(self, access: Any) -> None:
        if self._apart is not None:
            access.set_metadata("llvm.access.group", self._apart)

    # Numbers.

    def _value(self, expression: ast.expr) -> Any:
        match expression:
            case ast.Constant(value=bool(flag)):
                return _FLAG(int(flag))
            case ast.Constant(value=int(number)):
                return _INT(number)
            case ast.Name(id=name):
                if name in self._places:
                    place, kind = self._places[name]
                    return self._builder.load(place, typ=kind)
                return self._values[name]
            case ast.BinOp(left=left, op=operation, right=right):
                return self._operated(type(operation), self._value(left), self._value(right))
            case ast.Compare(left=left, ops=[comparison], comparators=[right]):
                word = _COMPARED[type(comparison)]
                return self._compared(word, self._value(left), self._value(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self._value(operand)
                is_real = isinstance(value.type, _REALS)
                return self._builder.fneg(value) if is_real else self._builder.neg(value)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self._builder.not_(self._value(operand))
            case ast.Call(func=ast.Name(id="get"), args=[array, at]):
                address, kind = self._address(array, at)
                number = self._builder.load(address, typ=kind)
                self._mark(number)
                return self._builder.trunc(number, _FLAG) if kind == _BYTE else number
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return getattr(self, f"call_{name}")(*map(self._value, arguments))
        raise UnknownOperationError(ast.unparse(expression))

    def _operated(self, operation: type[ast.operator], left: Any, right: Any) -> Any:
        if left.type != right.type:
            raise TypeError(f"an operation of {left.type} and {right.type}")
        of_reals, of_others = _OPERATIONS[operation]
        name = of_reals if isinstance(left.type, _REALS) else of_others
        return getattr(self._builder, str(name))(left, right)

    def _compared(self, comparison: str, one: Any, other: Any) -> Any:
        if one.type == _FLAG:
            return self._builder.icmp_unsigned(comparison, one, other)
        if not isinstance(one.type, _REALS):
            return self._builder.icmp_signed(comparison, one, other)
        if comparison == "!=":
            return self._builder.fcmp_unordered(comparison, one, other)
        return self._builder.fcmp_ordered(comparison, one, other)

    def _is_nan(self, value: Any) -> Any:
        return self._builder.fcmp_unordered("uno", value, value)

    # Functions that source may call.

    def call_select(self, flag: Any, one: Any, other: Any) -> Any:
        return self._builder.select(flag, one, other)

    def call_larger(self, one: Any, other: Any) -> Any:
        return self._of_two(">", one, other)

    def call_smaller(self, one: Any, other: Any) -> Any:
        return self._of_two("<", one, other)

    def _of_two(self, comparison: str, one: Any, other: Any) -> Any:
        """The first where it compares so with the second, else this; NaN if one of them is."""
        is_first = self._compared(comparison, one, other)
        if isinstance(one.type, _REALS):
            is_first = self._builder.or_(is_first, self._is_nan(one))
        return self._builder.select(is_first, one, other)

    def call_after(self, one: Any, other: Any) -> Any:
        """Whether the first comes after the second in their order, in which NaN is the last."""
        is_after = self._compared(">", one, other)
        if isinstance(one.type, _REALS):
            number = self._builder.fcmp_ordered("ord", other, other)
            nan = self._builder.and_(self._is_nan(one), number)
            is_after = self._builder.or_(is_after, nan)
        return is_after

    def call_real(self, value: Any) -> Any:
        is_real = isinstance(value.type, _REALS)
        return value if is_real else self._builder.sitofp(value, self._real)

    def call_int(self, value: Any) -> Any:
        return self._builder.fptosi(value, _INT)

    def call_sqrt(self, value: Any) -> Any:
        return self._builder.call(self.module.declare_intrinsic("llvm.sqrt", [self._real]), [value])

    def call_expm1(self, value: Any) -> Any:
        name = _EXPM1[type(self._real)]
        function = self.module.globals.get(name) or ir.Function(
            self.module, ir.FunctionType(self._real, [self._real]), name
        )
        return self._builder.call(function, [value])


_EXPM1 = {ir.FloatType: "expm1f", ir.DoubleType: "expm1"}


def compiled(text: str) -> bytes:
    """Machine code for this processor, of a module in LLVM's language."""
    machine = _machine()
    code: bytes = machine.emit_object(_optimised(text, machine))
    return code


def optimised(text: str) -> str:
    """The module in LLVM's language that code is made of."""
    return str(_optimised(text, _machine()))


def _optimised(text: str, machine: Any) -> Any:
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    module.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = True
    tuning.loop_unrolling = False  # it gains nothing and takes four times as long
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    return module


def loaded(code: bytes) -> tuple[int, Any]:
    """The address of the function, and what must be kept as long as it may be called."""
    _provide_functions()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine.get_function_address(NAME), engine


def processor() -> str:
    """What machine code depends on."""
    features = llvm.get_host_cpu_features().flatten()
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {features}"


def _machine() -> Any:
    """This processor: a new one every time, for a compiler disposes of its own."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        reloc="default",
        codemodel="jitdefault",
        jit=True,
    )


@functools.cache
def _provide_functions() -> None:
    """Let compiled code call the C library's functions."""
    library = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)
    if not hasattr(library, _EXPM1[ir.DoubleType]):
        library = ctypes.CDLL(ctypes.util.find_library("m"))
    for function in _EXPM1.values():
        address = ctypes.cast(getattr(library, function), ctypes.c_void_p).value
        llvm.add_symbol(function, address)
