"""Functions in C, statement by statement; every name is declared where the narrowest block needs it."""

import ast
from collections import Counter
from collections.abc import Iterator, Sequence

from twin_gait.firmware.expressions import Expressions, Naming
from twin_gait.firmware.function import Function, Functions
from twin_gait.firmware.kinds import BOOL, INT, Kind, ListKind, Scalar, TupleKind, type_name
from twin_gait.firmware.layout import INDENT, comment, identifier, wrapped


def declared(kind: Kind, name: str, is_written: bool) -> str:
    """Declaration of a name, of records and lists as an address."""
    if isinstance(kind, Scalar):
        return f"{kind.name} {name}"
    return f"{'' if is_written else 'const '}{type_name(kind)} *{name}"


class Printed:
    """Prints one function."""

    def __init__(self, functions: Functions, function: Function, naming: Naming) -> None:
        """Keep what is known of the function."""
        self.function, self.naming, self.tree = function, naming, function.source.tree
        self.expressions = Expressions(functions, function, naming)
        names = [item for item in ast.walk(self.tree) if isinstance(item, ast.Name)]
        self.stores = Counter(item.id for item in names if isinstance(item.ctx, ast.Store))
        self.read = {item.id for item in names if isinstance(item.ctx, ast.Load)}
        self.known = set(function.params)
        self.lines: list[str] = []
        self.depth = 0

    def signature(self) -> str:
        """Head of the function without its end."""
        function, returns = self.function, self.function.returns
        params = [
            declared(kind, self.expressions.local(name), name in function.written)
            for name, kind in function.params.items()
        ]
        result = returns.name if isinstance(returns, Scalar) else "void"
        if isinstance(returns, TupleKind):
            result = self.naming.result(function)
        return f"{result} {self.naming.of(function)}({', '.join(params) or 'void'})"

    def definition(self, *, exported: bool) -> list[str]:
        """The function with the first line of its docstring."""
        says = docstring_of_tree(self.tree)
        head = self.signature() if exported else f"static {self.signature()}"
        self.lines = [*comment(says), *wrapped(f"{head} {{", 0)]
        self.depth = 1
        for name in self.function.params:
            if name not in self.read:
                self._emit(f"(void){self.expressions.local(name)};")
        self._block(self.tree.body)
        return [*self.lines, "}"]

    def _emit(self, line: str) -> None:
        """A line at the present depth."""
        self.lines += wrapped(line, self.depth * INDENT)

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        """Statements, with the names that are of no narrower block."""
        first = {}
        for name in sorted(set(self.function.locals) - self.known):
            places = [number for number, item in enumerate(statements) if name in names_in(item)]
            if places and (len(places) > 1 or name not in _in_one_block(statements[places[0]])):
                first[name] = places[0]
        self.known |= first.keys()
        for number, item in enumerate(statements):
            fresh = {name for name, place in first.items() if place == number}
            for name in sorted(fresh - _assigned_by(item)):
                self._emit(f"{self._declaration(name)};")
            self._statement(item, fresh)
        self.known -= first.keys()

    def _declaration(self, name: str, *, once: bool = False) -> str:
        """Of a local name."""
        kind = self.function.locals[name]
        text = declared(kind, self.expressions.local(name), name in self.function.written)
        constant = once and isinstance(kind, Scalar) and self.stores[name] == 1
        return f"const {text}" if constant else text

    def _free(self, wanted: str) -> str:
        """A name that the function does not have yet."""
        used = {self.expressions.local(name) for name in (*self.function.locals, *self.function.params)}
        used |= {word for line in self.lines for word in line.replace("(", " ").replace(";", " ").split()}
        number = 1
        while (name := wanted if number == 1 else f"{wanted}_{number}") in used:
            number += 1
        return identifier(name, self.naming.taken)

    def _statement(self, node: ast.stmt, fresh: set[str]) -> None:
        """One statement; ``fresh`` are names that it declares if it assigns them."""
        match node:
            case ast.Assign(targets=[target], value=value):
                self._assign(target, value, fresh)
            case ast.If():
                self._condition(node, "if")
            case ast.For():
                self._loop(node)
            case ast.Return(value=value):
                self._returns(value)
            case ast.Expr(value=ast.Call() as call):
                self._emit(f"{self.expressions.call(call, None)};")
            case ast.Continue():
                self._emit("continue;")

    def _assign(self, target: ast.expr, value: ast.expr, fresh: set[str]) -> None:
        if not isinstance(target, ast.Tuple):
            self._store(target, self.expressions.value(value, self.function.kinds[target]), fresh)
            return
        assert isinstance(value, ast.Call)
        result, called = self._free("result"), self.function.calls[value]
        text = self.expressions.call(value, None)
        kept = [item for item in target.elts if not (isinstance(item, ast.Name) and item.id not in self.read)]
        if not kept:
            self._emit(f"(void){text};")
            return
        self._emit(f"const {self.naming.result(called)} {result} = {text};")
        for number, item in enumerate(target.elts):
            if item in kept:
                self._store(item, f"{result}.{result_name(number)}", fresh)

    def _store(self, target: ast.expr, text: str, fresh: set[str]) -> None:
        if isinstance(target, ast.Name) and target.id in fresh:
            self._emit(f"{self._declaration(target.id, once=True)} = {text};")
            return
        if isinstance(target, ast.Name):
            place = self.expressions.local(target.id)
        else:
            place = self.expressions.plain(target, self.function.kinds[target]).text  # type: ignore[arg-type]
        self._emit(f"{place} = {text};")

    def _condition(self, node: ast.If, word: str) -> None:
        self._emit(f"{word} ({self.expressions.value(node.test, BOOL)}) {{")
        self._inner(node.body)
        match node.orelse:
            case [ast.If() as other]:
                self._condition(other, "} else if")
                return
            case [_, *_]:
                self._emit("} else {")
                self._inner(node.orelse)
        self._emit("}")

    def _inner(self, statements: Sequence[ast.stmt], before: Sequence[str] = ()) -> None:
        self.depth += 1
        for line in before:
            self._emit(line)
        self._block(statements)
        self.depth -= 1

    def _loop(self, node: ast.For) -> None:
        first, before, target = "0", [], node.target
        match node.iter:
            case ast.Call(func=ast.Name(id="range"), args=args):
                first = self.expressions.value(args[0], INT) if len(args) == 2 else "0"
                end = self._end(args[-1], node.body)
                counter = self._counter(target)
            case ast.Call(func=ast.Name(id="enumerate"), args=[items]):
                assert isinstance(target, ast.Tuple)
                counter = self._counter(target.elts[0])
                end = self._over(items)
                before = [self._entry(target.elts[1], items, counter)]
            case items:
                counter = self._free("number")
                end = self._over(items)
                before = [self._entry(target, items, counter)]
        self._emit(f"for (int32_t {counter} = {first}; {counter} < {end}; {counter}++) {{")
        loops = {item.id for item in ast.walk(target) if isinstance(item, ast.Name)}
        added = loops - self.known
        self.known |= added
        self._inner(node.body, before)
        self.known -= added
        self._emit("}")

    def _counter(self, target: ast.expr) -> str:
        assert isinstance(target, ast.Name)
        return self.expressions.local(target.id)

    def _over(self, items: ast.expr) -> str:
        kind = self.function.kinds[items]
        assert isinstance(kind, ListKind)
        return str(kind.length)

    def _entry(self, target: ast.expr, items: ast.expr, counter: str) -> str:
        assert isinstance(target, ast.Name)
        text = f"{self.expressions.place(items)[0]}[{counter}]"
        text = text if isinstance(self.function.locals[target.id], Scalar) else f"&{text}"
        return f"{self._declaration(target.id, once=True)} = {text};"

    def _end(self, node: ast.expr, body: Sequence[ast.stmt]) -> str:
        """Where a loop ends; named before it if the loop may change what it is computed from."""
        text = self.expressions.value(node, INT)
        if self._is_steady(node, body):
            return text
        name = self._free("end")
        self._emit(f"const int32_t {name} = {text};")
        return name

    def _is_steady(self, node: ast.expr, body: Sequence[ast.stmt]) -> bool:
        inside = [item for statement in body for item in ast.walk(statement)]
        stores = [item for item in inside if isinstance(getattr(item, "ctx", None), ast.Store)]
        stored = {item.id for item in stores if isinstance(item, ast.Name)}
        fields = {item.attr for item in stores if isinstance(item, ast.Attribute)}
        calls = any(item in self.function.calls and self.function.calls[item].writes for item in inside)
        for item in ast.walk(node):
            if isinstance(item, ast.Name) and item.id in stored:
                return False
            if isinstance(item, ast.Attribute) and (calls or item.attr in fields):
                return False
            if isinstance(item, ast.Subscript) or item in self.function.calls:
                return False
        return True

    def _returns(self, value: ast.expr | None) -> None:
        kind = self.function.returns
        if value is None:
            self._emit("return;")
        elif isinstance(value, ast.Tuple) and isinstance(kind, TupleKind):
            parts = zip(value.elts, kind.items, strict=True)
            texts = ", ".join(self.expressions.value(item, part) for item, part in parts)
            self._emit(f"return ({self.naming.result(self.function)}){{{texts}}};")
        elif isinstance(kind, TupleKind):
            raise self.function.source.refused(value, "several numbers of another function; name them first")
        else:
            self._emit(f"return {self.expressions.value(value, kind)};")


def result_name(number: int) -> str:
    """Name of one of several numbers that a function returns, from 0 on."""
    return ("first", "second", "third", "fourth")[number] if number < 4 else f"number_{number + 1}"


def result_struct(function: Function, naming: Naming) -> list[str]:
    """Structure of several numbers that a function returns; nothing of another function."""
    if not isinstance(function.returns, TupleKind):
        return []
    fields = enumerate(function.returns.items)
    return [
        *comment(f"What {naming.of(function)} returns, in its order."),
        "typedef struct {",
        *(f"    {kind.name} {result_name(number)};" for number, kind in fields),
        f"}} {naming.result(function)};",
        "",
    ]


def docstring_of_tree(tree: ast.FunctionDef) -> str:
    """First line of the docstring of a function that was read."""
    return (ast.get_docstring(tree) or "").split("\n")[0]


def names_in(node: ast.AST) -> set[str]:
    """Names in a statement; those that a loop counts with are of that loop only."""
    if isinstance(node, ast.Name):
        return {node.id}
    found: set[str] = set().union(*(names_in(item) for item in ast.iter_child_nodes(node)))
    return found - names_in(node.target) if isinstance(node, ast.For) else found


def _in_one_block(node: ast.stmt) -> set[str]:
    """Names that one inner block of a statement has to itself."""
    blocks = list(_blocks(node))
    counts = Counter(name for block in blocks for name in set().union(*map(names_in, block), set()))
    outside: set[str] = set()
    for item in ast.iter_child_nodes(node):
        if not any(item is inner for block in blocks for inner in block):
            outside |= names_in(item)
    return {name for name, count in counts.items() if count == 1} - outside


def _blocks(node: ast.stmt) -> Iterator[list[ast.stmt]]:
    if isinstance(node, (ast.If, ast.For)):
        yield node.body
        yield node.orelse


def _assigned_by(node: ast.stmt) -> set[str]:
    """Names that an assignment may declare."""
    if not isinstance(node, ast.Assign):
        return set()
    target = node.targets[0]
    items = target.elts if isinstance(target, ast.Tuple) else [target]
    return {item.id for item in items if isinstance(item, ast.Name)}
