"""The normalised source of a function: its syntax tree without names, docstrings, annotations and dead branches.

`normal_form` serialises a tree itself, since `ast.dump` prints fields that differ between Python versions; it depends on the
standard library alone. `kernel_digest.py` beside it follows the functions that a kernel calls.
"""

from __future__ import annotations

import ast
import types
from collections.abc import Callable, Iterator, Sequence

Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
SCALARS = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), tuple, frozenset)
UNKNOWN = object()  # the value of an expression that is only known in a run
COMPARISONS: dict[type[ast.cmpop], Callable[..., object]] = {
    ast.Eq: lambda a, b: a == b, ast.NotEq: lambda a, b: a != b, ast.Lt: lambda a, b: a < b, ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b, ast.GtE: lambda a, b: a >= b, ast.Is: lambda a, b: a is b,
    ast.IsNot: lambda a, b: a is not b, ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip

Resolve = Callable[[str], object]  # the value of a name from outside the function; raises LookupError
Describe = Callable[[object], str]  # the text that stands for such a value


def parameters_of(arguments: ast.arguments) -> tuple[list[str], list[str]]:
    """Names of the ordinary parameters, and of `*args` and `**kwargs`."""
    ordinary = [one.arg for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return ordinary, [one.arg for one in (arguments.vararg, arguments.kwarg) if one]


def positions_of(code: types.CodeType) -> dict[str, int]:
    """Return the position of each parameter of a function, by name."""
    return {name: k for k, name in enumerate(code.co_varnames[: code.co_argcount + code.co_kwonlyargcount])}


# ---------------------------------------------------------------------- the text of a tree


def normal_form(tree: Function, resolve: Resolve, describe: Describe) -> str:
    """Return the text of a function's tree: equal texts mean equal functions, whatever their names.

    Locals and parameters are numbered in order of appearance. A name from outside is resolved and described by its value; a
    branch that such values decide is left out. Attributes of locals and of libraries keep their names.
    """
    return _Writer(resolve, describe).function(tree)


class _Writer:
    """Writes one function; a function inside it is written with the names of both."""

    def __init__(self, resolve: Resolve, describe: Describe):
        self.resolve, self.describe = resolve, describe
        self._scopes: list[set[str]] = []
        self._numbers: list[dict[str, int]] = []
        self._count = 0

    # ------------------------------------------------------------------ names

    def _local(self, name: str) -> str | None:
        """The number of a local, as text; None for a name from outside."""
        for names, numbers in zip(reversed(self._scopes), reversed(self._numbers), strict=True):
            if name in names:
                if name not in numbers:
                    numbers[name], self._count = self._count, self._count + 1
                return f"${numbers[name]}"
        return None

    def value(self, node: ast.expr) -> object:
        """Value of an expression before anything runs, or UNKNOWN."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name) and self._local(node.id) is None:
            return self._outside(node.id)
        if isinstance(node, ast.Attribute):
            base = self.value(node.value)
            return getattr(base, node.attr, UNKNOWN) if _is_namespace(base) else UNKNOWN
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            inner = self._scalar(node.operand)
            return UNKNOWN if inner is UNKNOWN else not inner
        if isinstance(node, ast.BoolOp):
            return self._bool(node)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            left, right = self._scalar(node.left), self._scalar(node.comparators[0])
            if left is not UNKNOWN and right is not UNKNOWN:
                try:
                    return bool(COMPARISONS[type(node.ops[0])](left, right))
                except TypeError:
                    return UNKNOWN
        return UNKNOWN

    def _outside(self, name: str) -> object:
        try:
            return self.resolve(name)
        except LookupError:
            return UNKNOWN

    def _scalar(self, node: ast.expr) -> object:
        value = self.value(node)
        return value if isinstance(value, SCALARS) else UNKNOWN

    def _bool(self, node: ast.BoolOp) -> object:
        """Return the value of an `and` or `or` that one operand decides, or whose operands are all known; else
        UNKNOWN."""
        values = [self._scalar(value) for value in node.values]
        decides = isinstance(node.op, ast.Or)
        if any(value is decides for value in values):
            return decides
        return UNKNOWN if any(value is not (not decides) for value in values) else not decides

    # ------------------------------------------------------------------ functions and statements

    def function(self, node: Function) -> str:
        """Text of a definition or a lambda: parameters by number, defaults, body."""
        ordinary, gathered = parameters_of(node.args)
        body = node.body if isinstance(node.body, list) else [ast.Return(node.body)]
        outer = {name for one in body for name in _outer_names(one)}
        self._scopes.append(({*ordinary, *gathered} | {n for one in body for n in _bound(one)}) - outer)
        self._numbers.append({})
        head = " ".join(str(self._local(name)) for name in (*ordinary, *gathered))
        stars = f"{bool(node.args.vararg):d}{bool(node.args.kwarg):d}{len(node.args.kwonlyargs)}"
        text = f"def({head};{stars})[{self.block(body)}]"
        self._scopes.pop()
        self._numbers.pop()
        return text

    def block(self, body: Sequence[ast.AST]) -> str:
        """Text of statements, without those that have no effect or follow one that leaves the block."""
        texts: list[str] = []
        for one in body:
            text = self.statement(one)
            if text:
                texts.append(text)
            if isinstance(one, ast.Return | ast.Raise | ast.Continue | ast.Break):
                break
        return ";".join(texts)

    def statement(self, node: ast.AST) -> str:
        if isinstance(node, ast.Pass) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            return ""
        if isinstance(node, ast.If):
            decided = self._scalar(node.test)
            if decided is not UNKNOWN:
                return self.block(node.body if decided else node.orelse)
        if isinstance(node, ast.AnnAssign):
            return "" if node.value is None else self.generic(ast.Assign([node.target], node.value))
        if isinstance(node, ast.FunctionDef):
            name = self._local(node.name)
            return f"{name}={self.function(node)}"
        return self.generic(node)

    # ------------------------------------------------------------------ expressions

    def expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return self.describe(node.value)
        if isinstance(node, ast.Name):
            return self._local(node.id) or self.outside(node.id)
        if isinstance(node, ast.IfExp):
            decided = self._scalar(node.test)
            if decided is not UNKNOWN:
                return self.expression(node.body if decided else node.orelse)
        if isinstance(node, ast.BoolOp):
            return self.bool_text(node)
        if isinstance(node, ast.Attribute):
            value = self.value(node)
            return f"{self.expression(node.value)}.{node.attr}" if value is UNKNOWN else self.describe(value)
        if isinstance(node, ast.Lambda):
            return self.function(node)
        if isinstance(node, ast.Call):
            return self.call(node)
        if isinstance(node, ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp):
            return self.comprehension(node)
        return self.generic(node)

    def outside(self, name: str) -> str:
        """Text of a name from outside; if nothing defines it, the name."""
        value = self._outside(name)
        return f"?{name}" if value is UNKNOWN else self.describe(value)

    def bool_text(self, node: ast.BoolOp) -> str:
        """Text of an `and` or `or` without the operands that do not matter."""
        decided = self._bool(node)
        if decided is not UNKNOWN:
            return self.describe(decided)
        left = [value for value in node.values if not isinstance(self._scalar(value), bool)]
        if len(left) == 1:
            return self.expression(left[0])
        return f"{type(node.op).__name__}({','.join(map(self.expression, left))})"

    def call(self, node: ast.Call) -> str:
        """Return the text of a call; keywords by position of the parameter if the function is known, else by name."""
        function = self.value(node.func)
        code = getattr(getattr(function, "py_func", function), "__code__", None)
        places = positions_of(code) if isinstance(code, types.CodeType) else {}
        named = sorted(f"{places.get(k.arg or '', k.arg)}={self.expression(k.value)}" for k in node.keywords)
        positional = [self.expression(argument) for argument in node.args]
        return f"{self.expression(node.func)}({','.join([*positional, *named])})"

    def comprehension(self, node: Comprehension) -> str:
        """Return the text of a comprehension, whose targets are local names."""
        self._scopes.append({n for one in node.generators for n in _bound(one.target)})
        self._numbers.append({})
        loops = ",".join(
            f"for({self.expression(g.target)},{self.expression(g.iter)},{','.join(map(self.expression, g.ifs))})"
            for g in node.generators
        )
        elements = [self.expression(getattr(node, name)) for name in ("key", "value", "elt") if hasattr(node, name)]
        self._scopes.pop()
        self._numbers.pop()
        return f"{type(node).__name__}({loops}:{','.join(elements)})"

    def generic(self, node: ast.AST) -> str:
        """Text of any other node: its type and its children in the order of its fields."""
        return f"{type(node).__name__}({','.join(self._children(node))})"

    def _children(self, node: ast.AST) -> Iterator[str]:
        for field in node._fields:
            if field in ("ctx", "kind", "type_comment", "type_params", "returns", "annotation", "decorator_list"):
                continue
            child = getattr(node, field, None)
            if isinstance(child, list) and field in ("body", "orelse", "finalbody", "handlers"):
                yield f"[{self.block(child)}]"
            elif isinstance(child, list):
                yield f"[{','.join(map(self._child, child))}]"
            else:
                yield self._child(child)

    def _child(self, child: object) -> str:
        if isinstance(child, ast.expr):
            return self.expression(child)
        if isinstance(child, ast.stmt):
            return self.statement(child)
        if isinstance(child, ast.AST):
            return self.generic(child)
        local = self._local(child) if isinstance(child, str) else None  # `except E as name`, `nonlocal name`
        return local or repr(child)


def _is_namespace(value: object) -> bool:
    """Return True for objects that hold functions or constants by name: a module, a SimpleNamespace, a NamedTuple."""
    return isinstance(value, types.ModuleType | types.SimpleNamespace) or hasattr(type(value), "_fields")


def _bound(node: ast.AST) -> Iterator[str]:
    """Names that a statement or target binds in the function around it."""
    if isinstance(node, ast.Name):
        if isinstance(node.ctx, ast.Store | ast.Del):
            yield node.id
        return
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        yield node.name
        return
    if isinstance(node, ast.Lambda | ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp):
        return
    if isinstance(node, ast.ExceptHandler) and node.name:
        yield node.name
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield from ((name.asname or name.name).split(".")[0] for name in node.names)
    for child in ast.iter_child_nodes(node):
        yield from _bound(child)


def _outer_names(node: ast.AST) -> Iterator[str]:
    """Names that a function declares global or nonlocal."""
    for child in ast.walk(node):
        if isinstance(child, ast.Global | ast.Nonlocal):
            yield from child.names
