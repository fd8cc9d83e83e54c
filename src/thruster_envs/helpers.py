"""Helpers of kernels: functions that Numba compiles into the kernels that call them, and nowhere else.

``numba.njit`` makes of each function a finished one: it is optimised, gets two entrances for Python and
becomes machine code, and then a kernel takes it in and all of that is done once more. Here a helper stays in
LLVM's intermediate form, merely simplified, until its kernel is optimised as a whole.

Left out: helpers that raise errors with values, or that print, for which Numba needs an environment.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


def njit(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a helper of kernels. Called from Python, it is what ``numba.njit`` would make of it.

    Args:
        function: The function; left out where there are options.
        **options: Those of ``numba.njit``.
    """

    def compiled(py_func: Callable[..., Any]) -> Any:
        alone: Any = numba.njit(**options)(py_func)
        if inspect.isfunction(alone) or options.get("inline") == "always":  # no calls are compiled
            return alone
        helper: Any = numba.njit(**options, pipeline_class=_HelperCompiler)(py_func)
        # A call from Python finds no overload, and asks what to call instead.
        helper._compile_for_args = lambda *_, **__: alone
        helper.add_overload = lambda result: helper.overloads.update({tuple(result.signature.args): result})
        return helper

    return compiled if function is None else compiled(function)


class _HelperLibrary(JITCodeLibrary):
    """Code that is linked into that of kernels and does not run by itself."""

    def finalize(self) -> None:
        """Link what it calls into it, take in what is to be inlined, and simplify."""
        codegen: Any = self._codegen
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        passes, builder = codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
        )
        passes.run(self._final_module, builder)
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class _HelperLowering(NativeLowering):
    """Lowers a function without entrances for Python and without machine code."""

    _name = "helper_lowering"

    def run_pass(self, state: Any) -> bool:
        flags, context = state.flags, state.targetctx
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        library: Any = _HelperLibrary
        state.library = library(context.codegen(), state.func_id.func_qualname)
        super().run_pass(state)  # type: ignore[no-untyped-call]
        state["cr"] = state["cr"]._replace(cfunc=_NoEntrance())
        context.insert_user_function(state["cr"].cfunc, state["cr"].fndesc, [state.library])
        return True


class _NoEntrance:
    """Names a compiled helper where Numba has the function that Python calls."""


class _HelperCompiler(CompilerBase):
    def define_pipelines(self) -> list[Any]:
        """Numba's own passes, but for the lowering."""
        builder: Any = DefaultPassBuilder
        manager = builder.define_nopython_pipeline(self.state)
        manager.passes = [
            (_HelperLowering if one is NativeLowering else one, name) for one, name in manager.passes
        ]
        manager._finalized = False
        manager.finalize()
        return [manager]
