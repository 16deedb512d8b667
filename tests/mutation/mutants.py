"""Mutants of a module: its source with one small change each.

Not changed: annotations, type aliases, decorators, imports, base classes, docstrings and the words inside f-strings.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from itertools import takewhile
from typing import Any, get_origin

_WIDTH = 70
"""Longest text [characters] that is shown of a change."""
_CONTEXT = 20
"""What is shown [characters] beside a change in a longer one."""

_COMPARED: Mapping[type[ast.cmpop], Sequence[type[ast.cmpop]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMPUTED: Mapping[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
_OTHER_FUNCTION = {"min": "max", "max": "min", "any": "all", "all": "any"}
_FORGOTTEN = {"abs", "bool", "round", "sorted", "reversed", "radians", "degrees"}
"""Functions of one argument that could be forgotten around it."""
_DELETED = (ast.Assign, ast.AugAssign, ast.AnnAssign, ast.Expr, ast.Raise, ast.Return, ast.Continue, ast.Break)

_Variants = Iterator[ast.AST]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One change of a module."""

    line: int
    where: str
    """The functions, classes and tables around it."""
    change: str
    """In words; these and the place are its name."""
    source: Callable[[], str]
    """The module with the change."""


def mutants(source: str, names: Mapping[str, object]) -> list[Mutant]:
    """Every mutant of a module, in the order of its lines; `names` is its namespace: enums and type aliases."""
    tree = ast.parse(source)
    enums = {
        name: list(value.__members__)
        for name, value in names.items()
        if isinstance(value, type) and issubclass(value, Enum)
    }
    aliases = {name for name, value in names.items() if get_origin(value) is not None}
    found: list[Mutant] = []
    seen: Counter[tuple[str, str]] = Counter()
    for site in _sites(tree, (), ""):
        if site.where in aliases:
            continue
        for variant in _variants(site, enums):
            change = _change(site, variant)
            seen[site.where, change] += 1
            number = seen[site.where, change]
            change = change if number == 1 else f"{change} ({number})"
            changed = partial(_changed, tree, site, variant)
            found.append(Mutant(line=site.line, where=site.where, change=change, source=changed))
    return found


def _changed(tree: ast.Module, site: _Site, variant: ast.AST) -> str:
    site.put(variant)
    try:
        return ast.unparse(tree)
    finally:
        site.put(site.node)


# ---------------------------------------------------------------------------------------------- where


@dataclass(frozen=True, slots=True, kw_only=True)
class _Site:
    """A node, and the place in its parent where a variant of it can stand."""

    node: ast.AST
    field: str
    index: int | None
    around: tuple[ast.AST, ...]
    """From the module to the parent."""
    where: str

    def put(self, node: ast.AST) -> None:
        parent = self.around[-1]
        if self.index is None:
            setattr(parent, self.field, node)
        else:
            getattr(parent, self.field)[self.index] = node

    @property
    def line(self) -> int:
        nodes = (self.node, *reversed(self.around))
        return next(node.lineno for node in nodes if isinstance(node, ast.expr | ast.stmt))


def _sites(parent: ast.AST, around: tuple[ast.AST, ...], where: str) -> Iterator[_Site]:
    around = (*around, parent)
    for field, value in ast.iter_fields(parent):
        for index, node in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(node, ast.AST) and not _is_left_alone(node, field, parent):
                inner = where + _step(node, field, index, around)
                yield _Site(node=node, field=field, index=index, around=around, where=inner.lstrip("."))
                yield from _sites(node, around, inner)


def _step(node: ast.AST, field: str, index: int | None, around: Sequence[ast.AST]) -> str:
    """What `node` adds to the name of a place: a function, a class, a name in one of these, an entry of a table."""
    match node, around[-1]:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name), _:
            return f".{name}"
        case (
            ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)),
            ast.Module() | ast.ClassDef(),
        ):
            return f".{name}"
        case _, ast.Dict(keys=keys) if field == "values" and index is not None and (key := keys[index]):
            inside = any(isinstance(outer, ast.FunctionDef) for outer in around)
            return "" if inside else f"[{ast.unparse(key)}]"
    return ""


def _is_left_alone(node: ast.AST, field: str, parent: ast.AST) -> bool:
    match parent, node:
        case _, ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant()):
            return True
        case _, ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.AnnAssign(annotation=ast.Name(id="TypeAlias")):
            return True
        case ast.JoinedStr(), ast.Constant():
            return True
        case ast.ClassDef(), _ if field in ("bases", "keywords"):
            return True
    return field in ("annotation", "returns", "decorator_list", "format_spec")


# ---------------------------------------------------------------------------------------------- what


def _variants(site: _Site, enums: Mapping[str, Sequence[str]]) -> _Variants:
    node = site.node
    if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del):
        return
    if isinstance(node, ast.Attribute):
        yield from _other_members(node, enums)
    yield from _MADE.get(type(node), _none)(node)
    function = next((outer for outer in reversed(site.around) if isinstance(outer, ast.FunctionDef)), None)
    is_last = function is not None and node is function.body[-1]
    if function and isinstance(node, _DELETED) and not (isinstance(node, ast.Return) and is_last):
        yield ast.Pass()


def _none(_: ast.AST) -> _Variants:
    return iter(())


def _with(node: ast.AST, **fields: object) -> ast.AST:
    variant = copy.copy(node)
    for name, value in fields.items():
        setattr(variant, name, value)
    return variant


def _without(items: Sequence[Any], index: int) -> list[Any]:
    return [*items[:index], *items[index + 1 :]]


def _other_members(node: ast.Attribute, enums: Mapping[str, Sequence[str]]) -> _Variants:
    members = enums.get(node.value.id, ()) if isinstance(node.value, ast.Name) else ()
    if node.attr in members and len(members) > 1:
        yield _with(node, attr=members[(members.index(node.attr) + 1) % len(members)])


def _comparisons(node: ast.Compare) -> _Variants:
    for index, operator in enumerate(node.ops):
        for other in _COMPARED[type(operator)]:
            yield _with(node, ops=[*node.ops[:index], other(), *node.ops[index + 1 :]])


def _computations(node: ast.BinOp | ast.AugAssign) -> _Variants:
    yield _with(node, op=_COMPUTED[type(node.op)]())


def _decisions(node: ast.BoolOp) -> _Variants:
    yield _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    for index in range(len(node.values)):
        rest = _without(node.values, index)
        yield rest[0] if len(rest) == 1 else _with(node, values=rest)


def _without_sign(node: ast.UnaryOp) -> _Variants:
    yield node.operand


def _constants(node: ast.Constant) -> _Variants:
    values: tuple[bool | int | float | str | bytes, ...] = ()
    match node.value:
        case bool(value):
            values = (not value,)
        case int(value):
            values = (value + 1, value - 1)
        case float(value):
            values = (value * 1.1, value * 0.9) if value else (1.0, -1.0)
        case str(value):
            values = ("" if value else "?",)
        case bytes(value):
            values = (b"" if value else b"?",)
    yield from (ast.Constant(value) for value in values)


def _calls(node: ast.Call) -> _Variants:
    name = node.func.id if isinstance(node.func, ast.Name) else ""
    if name in _OTHER_FUNCTION:
        yield _with(node, func=ast.Name(_OTHER_FUNCTION[name]))
    if name in _FORGOTTEN:
        yield node.args[0]
    for index in range(len(node.keywords)):
        yield _with(node, keywords=_without(node.keywords, index))


def _entries(node: ast.Dict) -> _Variants:
    for index, (key, value) in enumerate(zip(node.keys, node.values, strict=True)):
        yield _with(node, keys=_without(node.keys, index), values=_without(node.values, index))
        following = [*node.values[index + 1 :], *node.values[:index]]
        other = next((found for found in following if ast.unparse(found) != ast.unparse(value)), None)
        if key and other and not isinstance(value, ast.Constant):
            yield _with(node, values=[*node.values[:index], other, *node.values[index + 1 :]])


def _elements(node: ast.Tuple | ast.List | ast.Set) -> _Variants:
    for index in range(len(node.elts) if len(node.elts) > 1 else 0):
        yield _with(node, elts=_without(node.elts, index))


def _bounds(node: ast.Slice) -> _Variants:
    for bound in ("lower", "upper"):
        if getattr(node, bound):
            yield _with(node, **{bound: None})


def _tests(node: ast.If | ast.While | ast.IfExp) -> _Variants:
    if not isinstance(node.test, ast.Compare | ast.UnaryOp | ast.Constant):  # those have this variant themselves
        yield _with(node, test=ast.UnaryOp(ast.Not(), node.test))


def _filters(node: ast.comprehension) -> _Variants:
    for index in range(len(node.ifs)):
        yield _with(node, ifs=_without(node.ifs, index))


def _cases(node: ast.match_case) -> _Variants:
    yield _with(node, guard=ast.Constant(False))


def _returns(node: ast.Return) -> _Variants:
    if node.value and not (isinstance(node.value, ast.Constant) and isinstance(node.value.value, bool | None)):
        yield _with(node, value=ast.Constant(None))


_MADE: Mapping[type[ast.AST], Callable[[Any], _Variants]] = {
    ast.Compare: _comparisons,
    ast.BinOp: _computations,
    ast.AugAssign: _computations,
    ast.BoolOp: _decisions,
    ast.UnaryOp: _without_sign,
    ast.Constant: _constants,
    ast.Call: _calls,
    ast.Dict: _entries,
    ast.Tuple: _elements,
    ast.List: _elements,
    ast.Set: _elements,
    ast.Slice: _bounds,
    ast.If: _tests,
    ast.While: _tests,
    ast.IfExp: _tests,
    ast.comprehension: _filters,
    ast.match_case: _cases,
    ast.Return: _returns,
}


# ---------------------------------------------------------------------------------------------- in words


def _change(site: _Site, variant: ast.AST) -> str:
    """The change with as much around it as fits a line."""
    shown = site.node
    for outer in reversed(site.around):
        if isinstance(outer, ast.Match) or (hasattr(outer, "body") and not isinstance(outer, ast.IfExp | ast.Lambda)):
            break
        if isinstance(outer, ast.expr | ast.stmt):
            if len(ast.unparse(outer)) > _WIDTH:
                break
            shown = outer
    before = ast.unparse(shown)
    site.put(variant)
    after = ast.unparse(variant if shown is site.node else shown)
    site.put(site.node)
    if isinstance(site.node, ast.match_case | ast.If | ast.While):
        before, after = before.strip().split("\n")[0], after.strip().split("\n")[0]
    return "`{}` -> `{}`".format(*_shortened(before, after))


def _shortened(before: str, after: str) -> tuple[str, str]:
    """Of long texts: where they differ, from word to word."""
    if max(len(before), len(after)) <= _WIDTH + _CONTEXT:
        return before, after
    start = _common(before, after)
    end = _common(before[start:][::-1], after[start:][::-1])
    start = before.rfind(" ", 0, max(0, start - _CONTEXT)) + 1
    end = len(before) - (before + " ").find(" ", len(before) - max(0, end - _CONTEXT))
    return before[start : len(before) - end], after[start : len(after) - end]


def _common(one: str, other: str) -> int:
    """Characters at the beginning that are the same."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
