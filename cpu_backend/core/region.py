"""The one parallel region of all team kernels: its members enter a kernel by address.

numba makes four nested functions of a parallel loop's body, and optimises and emits all that the body calls with each:
most of the compile time of a large kernel. So there is only one such loop, over integers, that calls a function at an
address. A kernel passes it the address of its own body and of the arguments, which are packed on the stack of the
thread that called the kernel.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler as NumbaCompiler
from numba.core.compiler_machinery import PassManager
from numba.extending import intrinsic

from softlab.cpu_backend.core.subnormals import FLUSH, flush_subnormals, write_register
from softlab.model.base.types import Compile

_built_in: Compile = intrinsic  # typed by numba when they are compiled
_ENTRY = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), ir.IntType(64)])  # packed arguments, member


class _NoEnvironment:
    """Replacement of the engine that emits a library's code."""

    def set_env(self, name: str, environment: object) -> None:
        """Ignore the environment: linked code is not emitted and has none (see Compiler)."""


class LinkedLibrary(JITCodeLibrary):
    """Code that is only linked into other code: emitted there, not on its own."""

    codegen = _NoEnvironment()

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0


class _BodyLibrary(LinkedLibrary):
    """Code of a single function, which is optimised with it and not separately."""

    def _optimize_final_module(self) -> None:
        pass


class LinkedPipeline(NumbaCompiler):
    """The numba pipeline of functions that only kernels call."""

    library = LinkedLibrary

    def define_pipelines(self) -> list[PassManager]:
        self.state.library = self.library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class BodyPipeline(LinkedPipeline):
    """The same pipeline for the body of a parallel kernel."""

    library = _BodyLibrary


@_built_in
def enter(typing_context, entry, arguments, member):
    """Call the body at address `entry` with the packed arguments, as `member` of its team."""

    def build(context, builder, signature, values):
        function = builder.inttoptr(values[0], _ENTRY.as_pointer())
        packed = builder.inttoptr(values[1], ir.IntType(8).as_pointer())
        builder.call(function, [packed, values[2]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), build


def region(entry, arguments, members):
    """Run the body once per member."""
    for member in numba.prange(members):
        enter(entry, arguments, np.int64(member))


@_built_in
def packed(typing_context, body, first, members, values):
    """Return the addresses of a kernel's body and of its arguments. The body is called as body(*first, member, members,
    *values)."""
    taken = (*first.types, types.int64, members, *values.types)
    place_of_member = len(first.types)
    flushed = FLUSH and body.dispatcher.targetoptions.get("fastmath")

    def build(context, builder, signature, values):
        compiled = body.dispatcher.overloads[taken]
        context.active_code_library.add_linking_library(compiled.library)
        handed = [*cgutils.unpack_tuple(builder, values[1]), values[2], *cgutils.unpack_tuple(builder, values[3])]
        layout = ir.LiteralStructType([value.type for value in handed])
        memory = cgutils.alloca_once(builder, layout)
        for k, value in enumerate(handed):
            builder.store(value, cgutils.gep_inbounds(builder, memory, 0, k))

        entry = ir.Function(builder.module, _ENTRY, name=f"entry.{compiled.fndesc.mangled_name}")
        entry.linkage = "internal"
        inner = ir.IRBuilder(entry.append_basic_block())
        source = inner.bitcast(entry.args[0], layout.as_pointer())
        arguments = [inner.load(cgutils.gep_inbounds(inner, source, 0, k)) for k in range(len(handed))]
        arguments.insert(place_of_member, entry.args[1])
        function = context.declare_function(builder.module, compiled.fndesc)
        returned, expected = compiled.fndesc.restype, compiled.fndesc.argtypes
        before = flush_subnormals(inner) if flushed else None
        context.call_conv.call_function(inner, function, returned, expected, arguments)  # bodies raise nothing
        if flushed:
            write_register(inner, before)
        inner.ret_void()
        addresses = [builder.ptrtoint(pointer, ir.IntType(64)) for pointer in (entry, memory)]
        return context.make_tuple(builder, signature.return_type, addresses)

    body.dispatcher.compile(taken)  # before the code around it is compiled
    return types.UniTuple(types.int64, 2)(body, first, members, values), build
