"""Printing of functions as C, statement by statement, with each name declared in the narrowest block."""

import ast
from collections import Counter
from collections.abc import Sequence

from twin_gait.firmware.expressions import Expressions
from twin_gait.firmware.function import Function, Functions
from twin_gait.firmware.kinds import BOOL, INT, Kind, ListKind, Scalar, type_name
from twin_gait.firmware.layout import INDENT, RESERVED_WORDS, comment, identifier, wrapped
from twin_gait.firmware.values import Value


class Statements(Expressions):
    """Analysis and printing of one function."""

    def __init__(
        self, functions: Functions, function: Function, taken: frozenset[str] = RESERVED_WORDS
    ) -> None:
        """Prepare the analysis of a function; the arguments are those of :class:`Expressions`."""
        super().__init__(functions, function, taken)
        names = [item for item in ast.walk(self.source.tree) if isinstance(item, ast.Name)]
        self.stores = Counter(item.id for item in names if isinstance(item.ctx, ast.Store))
        self.read = {item.id for item in names if isinstance(item.ctx, ast.Load)}
        self.declared = set(function.params)
        self.lines: list[str] = []
        self.depth = 0

    def signature(self) -> str:
        """Return the declaration of the function in C, without its last character."""
        params = [self._declaration(name) for name in self.function.params]
        return f"{self.function.result} {self.function.name}({', '.join(params) or 'void'})"

    def definition(self, *, exported: bool) -> list[str]:
        """Return the lines of the function in C, below a comment with the first line of its docstring."""
        summary = (ast.get_docstring(self.source.tree) or "").split("\n")[0]
        head = self.signature() if exported else f"static {self.signature()}"
        self.lines = [*comment(summary), *wrapped(f"{head} {{", 0)]
        self.depth = 1
        for name in self.function.params:
            if name not in self.read:
                self._emit(f"(void){self.local(name)};")
        self._block(self.source.tree.body)
        return [*self.lines, "}"]

    def _emit(self, line: str) -> None:
        """Add a line at the present depth."""
        self.lines += wrapped(line, self.depth * INDENT)

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        """Print statements, and declare the names that no narrower block contains."""
        first = {}
        for name in sorted(set(self.function.locals) - self.declared):
            indices = [number for number, item in enumerate(statements) if name in names_in(item)]
            if indices and (len(indices) > 1 or name not in _in_one_block(statements[indices[0]])):
                first[name] = indices[0]
        self.declared |= first.keys()
        for number, item in enumerate(statements):
            fresh = {name for name, index in first.items() if index == number}
            for name in sorted(fresh - _assigned_by(item)):
                self._emit(f"{self._declaration(name)};")
            self._statement(item, fresh)
        self.declared -= first.keys()

    def _declaration(self, name: str, *, once: bool = False) -> str:
        """Return the declaration of a name.

        Records and lists are declared as addresses; a number that is stored once is constant.
        """
        kind = self.kind_of_name(name)
        if isinstance(kind, Scalar):
            constant = once and self.stores[name] == 1
            return f"{'const ' if constant else ''}{kind} {self.local(name)}"
        written = name in self.function.written
        return f"{'' if written else 'const '}{type_name(kind)} *{self.local(name)}"

    def _free(self, preferred: str) -> str:
        """Return a name that the function does not use yet, with a number if ``wanted`` is in use."""
        used = {self.local(name) for name in (*self.function.locals, *self.function.params)}
        used |= {word for line in self.lines for word in line.replace("(", " ").replace(";", " ").split()}
        number = 1
        while (name := preferred if number == 1 else f"{preferred}_{number}") in used:
            number += 1
        return identifier(name, self.taken)

    def _statement(self, node: ast.stmt, fresh: set[str]) -> None:
        """Print one statement; ``fresh`` are names that it declares if it assigns them."""
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                self._assign_several(node, targets, value, fresh)
            case ast.Assign(targets=[target], value=value):
                # C may compute the index of an entry before or after the value.
                mixed = any(isinstance(item, ast.Subscript) for item in ast.walk(target))
                self._assign(
                    target, value, self.value(value) if mixed else self.statement_value(value), fresh
                )
            case ast.If():
                self._condition(node, "if")
            case ast.For(orelse=[]):
                self._loop(node)
            case ast.Return():
                self._return(node)
            case ast.Expr(value=ast.Call() as call):
                self._emit(f"{self.statement_value(call).text};")
            case ast.Continue():
                self._emit("continue;")
            case ast.Break():
                self._emit("break;")
            case ast.Expr(value=ast.Constant(value=str(text))):
                if node is not self.source.tree.body[0]:  # The docstring is printed above the function.
                    self.lines += comment(text, self.depth * INDENT)
            case ast.Pass():
                pass
            case _:
                raise self.source.print_error(node, "this kind of statement cannot be printed")

    def _assign_several(
        self, node: ast.stmt, targets: Sequence[ast.expr], call: ast.expr, fresh: set[str]
    ) -> None:
        """Assign the numbers that a function returns to as many names or fields."""
        found = self.statement_value(call)
        if not isinstance(found.kind, tuple) or len(found.kind) != len(targets):
            raise self.source.print_error(node, "the number of names differs from the number of values")
        assert isinstance(call, ast.Call)
        result = self._free("result")
        self._emit(f"const {self.function.calls[call].result} {result} = {found.text};")
        fields = result_names(self.function.calls[call])
        for field, target, kind in zip(fields, targets, found.kind, strict=True):
            part = Value(kind, f"{result}.{field}")
            self._assign(target, call, part, fresh)

    def _assign(self, target: ast.expr, node: ast.expr, value: Value, fresh: set[str]) -> None:
        if isinstance(target, ast.Name) and target.id not in self.read and "(" not in value.text:
            return  # for a build flag that excludes the code that reads it
        if isinstance(target, ast.Name):
            kind = self._declare(target, node, value)
            name = target.id
            left = self._declaration(name, once=True) if name in fresh else self.local(name)
        else:
            to = self.value(target)
            kind, left = to.kind, to.text
            if not isinstance(kind, Scalar):
                raise self.source.print_error(target, "a record or list can only be changed entry by entry")
            self.mark_written(Value(None, "", name=to.name, fields=to.fields[:-1]))
        self._emit(f"{left} = {self.fit(node, value, kind).text};")

    def _declare(self, target: ast.Name, node: ast.expr, value: Value) -> Kind:
        """Record that a name has a value after this statement; return its kind in the whole function."""
        function, name = self.function, target.id
        if value.kind is None or isinstance(value.kind, tuple):
            raise self.source.print_error(node, "is not a single value")
        if name in function.params and not isinstance(value.kind, Scalar):
            raise self.source.print_error(target, "an argument that is a record or list cannot be reassigned")
        kind = function.params.get(name) or function.locals.setdefault(name, value.kind)
        self.fit(node, value, kind)
        if not isinstance(kind, Scalar):
            function.aliases.setdefault(name, []).append(value)
            if name in function.written:
                self.mark_written(value)
        return kind

    def _condition(self, node: ast.If, word: str) -> None:
        self._emit(f"{word} ({self.fit(node.test, self.statement_value(node.test), BOOL).text}) {{")
        self._inner(node.body)
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            self._condition(node.orelse[0], "} else if")
            return
        if node.orelse:
            self._emit("} else {")
            self._inner(node.orelse)
        elif word != "if":
            self._emit("} else {")
            self._emit("    /* Nothing to do. */")
        self._emit("}")

    def _inner(self, statements: Sequence[ast.stmt], first: str = "") -> None:
        self.depth += 1
        if first:
            self._emit(first)
        self._block(statements)
        self.depth -= 1

    def _loop(self, node: ast.For) -> None:
        """Print a loop over numbers or over a list, whose entry has a name of its own within the loop."""
        first, entry = "0", ""
        match node.iter, node.target:
            case ast.Call(func=ast.Name(id="range"), args=args), ast.Name() as number if len(args) in (1, 2):
                if len(args) == 2:
                    first = self.expect(args[0], INT).text
                end, counter = self._end(args[-1], node.body), self._counter(number)
            case ast.Call(func=ast.Name(id="enumerate"), args=[items]), ast.Tuple(
                elts=[ast.Name() as number, ast.Name() as item]
            ):
                counter = self._counter(number)
                end, entry = self._entry(item, items, counter)
            case items, ast.Name() as item:
                counter = self._free("number")
                end, entry = self._entry(item, items, counter)
            case _:
                raise self.source.print_error(node.iter, "a loop must be over range, enumerate or a list")
        counted = names_in(node.target)
        if not counted.isdisjoint(_stored_in(node.body)):
            raise self.source.print_error(node.target, "the loop variable must not be assigned in the loop")
        self._emit(f"for (int32_t {counter} = {first}; {counter} < {end}; {counter}++) {{")
        added = counted - self.declared
        self.declared |= added
        self._inner(node.body, entry)
        self.declared -= added
        self._emit("}")

    def _counter(self, target: ast.Name) -> str:
        self._declare(target, target, Value(INT, ""))
        return self.local(target.id)

    def _entry(self, target: ast.Name, node: ast.expr, counter: str) -> tuple[str, str]:
        """Return the length of a list, and the statement that names its present entry."""
        items = self.value(node)
        length, fields = self.length(node, items), (*items.fields, None)
        assert isinstance(items.kind, ListKind)  # because it has a length
        entry = Value(items.kind.item, f"{items.text}[{counter}]", name=items.name, fields=fields)
        kind = self._declare(target, node, entry)
        text = f"{self._declaration(target.id, once=True)} = {entry.in_kind(kind).text};"
        return str(length), text

    def _end(self, node: ast.expr, body: Sequence[ast.stmt]) -> str:
        """Return the end of a loop, which Python computes before the loop and C in every iteration."""
        text, stored = self.expect(node, INT).text, _stored_in(body)
        inside = {item for statement in body for item in ast.walk(statement)}
        writes = any(call in inside and called.writes for call, called in self.function.calls.items())
        for item in () if text.isdigit() else ast.walk(node):
            if ast.unparse(item) in stored or (writes and isinstance(item, ast.Attribute)):
                raise self.source.print_error(node, "may change in the loop; assign it to a name before")
        return text

    def _return(self, node: ast.Return) -> None:
        function = self.function
        if node.value is None:
            self._emit("return;")
        elif isinstance(node.value, ast.Tuple):
            items = node.value.elts
            values, _ = self.numbers(items)
            kinds = tuple(value.kind for value in values if isinstance(value.kind, Scalar))
            function.returns = function.returns or kinds
            assert isinstance(function.returns, tuple)
            parts = zip(items, values, function.returns, strict=True)
            texts = ", ".join(self.fit(item, value, kind).text for item, value, kind in parts)
            self._emit(f"return ({function.result}){{{texts}}};")
        else:
            value = self.statement_value(node.value)
            if isinstance(value.kind, tuple):
                raise self.source.print_error(
                    node.value, "several numbers of another function; assign them to names first"
                )
            if not isinstance(value.kind, Scalar):
                raise self.source.print_error(node, "a record or list cannot be returned")
            function.returns = function.returns or value.kind
            self._emit(f"return {self.fit(node.value, value, function.returns).text};")


def result_names(function: Function) -> list[str]:
    """Return the names of the numbers that a function returns, taken from its return statements.

    A number without a name, or with the name of another number, is named by its position: ``value_1``.
    """
    assert isinstance(function.returns, tuple)
    found = [f"value_{position}" for position in range(1, len(function.returns) + 1)]
    for node in ast.walk(function.source.tree):
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple):
            for position, item in enumerate(node.value.elts):
                if isinstance(item, ast.Name) and identifier(item.id) not in found:
                    if found[position] == f"value_{position + 1}":
                        found[position] = identifier(item.id)
    return found


def result_struct(function: Function) -> list[str]:
    """Return the structure of several numbers that a function returns; empty for other functions."""
    if not isinstance(function.returns, tuple):
        return []
    fields = zip(function.returns, result_names(function), strict=True)
    return [
        *comment(f"Results of {function.name}, in the order in which it returns them."),
        "typedef struct {",
        *(f"    {kind} {name};" for kind, name in fields),
        f"}} {function.result};",
        "",
    ]


def names_in(node: ast.AST) -> set[str]:
    """Return the names in a statement without loop variables, which exist in their loops only."""
    if isinstance(node, ast.Name):
        return {node.id}
    found: set[str] = set().union(*(names_in(item) for item in ast.iter_child_nodes(node)))
    return found - names_in(node.target) if isinstance(node, ast.For) else found


def _stored_in(statements: Sequence[ast.stmt]) -> set[str]:
    """Return the text of all names, fields and entries that some statements assign."""
    inside = (item for statement in statements for item in ast.walk(statement))
    return {ast.unparse(item) for item in inside if isinstance(getattr(item, "ctx", None), ast.Store)}


def _in_one_block(node: ast.stmt) -> set[str]:
    """Return the names that only one inner block of a statement uses."""
    match node:
        case ast.If():
            head = names_in(node.test)
        case ast.For():
            head = names_in(node.iter) | names_in(node.target)
        case _:
            return set()
    first, second = (set().union(*map(names_in, block)) for block in (node.body, node.orelse))
    return (first ^ second) - head


def _assigned_by(node: ast.stmt) -> set[str]:
    """Return the names that an assignment may declare."""
    targets = node.targets if isinstance(node, ast.Assign) else []
    inside = (item for target in targets for item in ast.walk(target))
    return {item.id for item in inside if isinstance(item, ast.Name) and isinstance(item.ctx, ast.Store)}
