"""Commands of declared experiments (bench/experiments/registry.py), built from their declarations when they are used."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import GenericAlias
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.main import get_command_from_info
from typer.models import CommandInfo

from softlab.app.command.command_line import DEFAULT_STORE, StorePath
from softlab.bench.experiments.registry import EXPERIMENTS, experiments
from softlab.bench.measure.took import Timed
from softlab.bench.options import Backends, Cluster, Sbatch, Workers, measure, where_asked
from softlab.model.base.errors import SceneError

if TYPE_CHECKING:  # which imports the solvers
    from softlab.bench.measure.declaration import Experiment, Option

BACKEND, QUICK, STORE, WORDS = "backend", "quick", "store", "names"  # parameters that are not options of an experiment
Parameters = dict[str, tuple[object, object]]  # parameter of a command -> its type and its default


class DeclaredCommand(Timed):
    """A command whose help, parameters and callback are built on first use: no other command imports its experiments."""

    def __init__(self, **how: Any):
        super().__init__(**how)
        for name in ("params", "callback", "epilog", "help"):
            del self.__dict__[name]

    def __getattr__(self, name: str) -> Any:
        if name == "help":
            self.help = _docstring(EXPERIMENTS[str(self.name)][0])
        elif name in ("params", "callback", "epilog"):
            declared = experiments(str(self.name))
            info = CommandInfo(callback=command_function(declared))
            built = get_command_from_info(info, pretty_exceptions_short=True, rich_markup_mode="rich")
            self.params, self.callback, self.epilog = built.params, built.callback, f"Example: {declared[0].example}"
        else:
            raise AttributeError(name)
        return self.__dict__[name]


def _docstring(place: str) -> str:
    """Return the docstring of the class at `module:name`, read from its source without importing it."""
    module, _, name = place.partition(":")
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    declared = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name)
    return ast.get_docstring(declared) or ""


def add_commands(app: typer.Typer) -> None:
    """Add a command for every command of the registry that the app does not have yet."""
    known = {info.name or info.callback.__name__ for info in app.registered_commands if info.callback}
    for name in EXPERIMENTS:
        if name not in known:
            app.command(name, cls=DeclaredCommand)(lambda: None)


def _argument(option: Option) -> str:
    """Return the name of an option's parameter: `--kind` becomes `kind`."""
    return option.flag.lstrip("-").replace("-", "_")


def _annotated(option: Option, negated: bool = False) -> Any:
    """Return the type of an option's parameter, with the words of its help; `negated`: a switch with --no- beside it."""
    kind: Any = bool if option.type is bool else GenericAlias(list, (option.type,)) | None
    flag = f"{option.flag}/--no-{option.flag.lstrip('-')}" if negated else option.flag
    return Annotated[kind, typer.Option(flag, help=option.help)]


def _parameters(declared: Sequence[Experiment], options: Collection[Option]) -> Parameters:
    """Return the type and the default of each parameter of a command."""
    from softlab.bench.measure.declaration import PRECISION, Option

    parameters: Parameters = {QUICK: (_annotated(Option("--quick", declared[0].quick_help, bool)), False)}
    switches = [one.switch for one in declared if one.switch]
    for option in (*switches, *(one for one in options if one is not PRECISION)):
        default = bool(option.usual) if option.type is bool else None
        parameters[_argument(option)] = _annotated(option, bool(default)), default
        if option.words:
            words = typer.Argument(metavar=option.words, help=f"Same as {option.flag}.", show_default=False)
            parameters[WORDS] = Annotated[list[str] | None, words], None
    parameters |= {_argument(one.extra): (_annotated(one.extra, True), None) for one in declared if one.extra}
    if any(one.on_backends for one in declared):
        parameters[BACKEND] = Backends, None
    if PRECISION in options:
        parameters[_argument(PRECISION)] = _annotated(PRECISION), None
    if declared[0].on_workers:
        parameters |= {"cluster": (Cluster, None), "workers": (Workers, None), "sbatch": (Sbatch, None)}
    return parameters | {STORE: (StorePath, DEFAULT_STORE)}


def command_function(declared: Sequence[Experiment]) -> Callable[..., None]:
    """Return the function of a command, whose parameters are the options of its experiments."""
    from softlab.bench.measure.declaration import PRECISION

    switches = {one: one.switch for one in declared if one.switch}
    options = {name: option for one in declared for name, option in one.options.items()}
    parameters = _parameters(declared, options.values())

    def run(**values: Any) -> None:
        asked = [one for one, switch in switches.items() if values[_argument(switch)]]
        if len(asked) > 1:
            first, second = (switches[one].flag for one in asked[:2])
            raise SceneError(second, True, f"cannot be combined with {first}; leave one out")
        selected = asked or [one for one in declared if one not in switches]
        wanted = {}
        for name, option in options.items():
            value = values[_argument(option)]
            if option.words:
                value = [*(values[WORDS] or ()), *(value or ())]
            if value not in ([], parameters[_argument(option)][1]):
                wanted[name] = value
        _check_options(declared, selected, {name: (options[name], value) for name, value in wanted.items()})
        workers = [values[name] for name in ("cluster", "workers", "sbatch")] if declared[0].on_workers else [None] * 3
        where = where_asked(*workers)
        for one in selected:
            extra = values[_argument(one.extra)] if one.extra else None
            has_all = all(
                name in one.options or options[name] is PRECISION for name in wanted
            )  # else no part is wanted
            if extra or (extra is None and has_all):
                chosen = {name: value for name, value in wanted.items() if name in one.options}
                backends = {"backends": values[BACKEND]} if one.on_backends else {}
                summary = measure(
                    values[STORE], one, {QUICK: values[QUICK], **backends, **chosen}, show=one.show, report=one.report,
                    where=where, timed=one.timed,
                )  # fmt: skip
                if status := one.exit_status(summary):
                    raise typer.Exit(status)

    run.__dict__["__signature__"] = inspect.Signature([
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (annotation, default) in parameters.items()
    ])  # fmt: skip
    run.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return run


def _check_options(
    declared: Sequence[Experiment], selected: Sequence[Experiment], wanted: Mapping[str, tuple[Option, Any]]
) -> None:
    """Raise SceneError for an option that applies to no selected experiment."""
    for name, (option, value) in wanted.items():
        if any(name in one.options for one in selected):
            continue
        flags = [one.switch.flag if one.switch else "" for one in declared if name in one.options]
        switch = selected[0].switch
        if all(flags):
            remedy = f"applies to {' and '.join(flags)}; add {'it' if len(flags) == 1 else 'one of them'}"
        else:
            remedy = f"does not apply to {switch.flag if switch else 'this'}; leave one out"
        raise SceneError(option.flag, value if option.type is bool else value[0], remedy)
