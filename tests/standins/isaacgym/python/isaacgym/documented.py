"""Classes, functions and constants as a stub file documents them, and refusals of all else."""

import ast
import re
from pathlib import Path


class Refused(AttributeError):
    """The stubs do not have the name that was asked for."""

    def __init__(self, owner, name):
        super().__init__(f"{owner} has no {name!r} in the stubs")


class NotPlayed(NotImplementedError):
    """The stubs have it, the stand-in does not."""

    def __init__(self, owner, name):
        super().__init__(f"the stand-in does not play {owner}.{name}")


class Stubs:
    """The content of a stub file: its classes and functions by their names, its constants with their types."""

    def __init__(self, path):
        source = re.sub(r"\bdef (lambda)\(", r"def \1_(", Path(path).read_text(encoding="utf-8"))
        tree = ast.parse(source)
        self.classes = {node.name: Documented(node) for node in tree.body if isinstance(node, ast.ClassDef)}
        self.functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.constants = _annotated(tree.body)


class Documented:
    """One class of the stubs: `fields` of its objects with their types, `methods` by their names."""

    def __init__(self, node):
        self.name = node.name
        self.text = ast.get_docstring(node, clean=False) or ""
        functions = [one for one in node.body if isinstance(one, ast.FunctionDef)]
        self.methods = {one.name: one for one in functions}
        self.fields = _annotated(node.body)
        self.fields.update({one.name: "" for one in functions if one.decorator_list})  # properties

    @property
    def members(self):
        """Members of an enum, in the order of its documentation; none of another class."""
        named = re.findall(r"^\s+([A-Z][A-Z0-9_]*) : ", self.text, re.MULTILINE)
        return [one for one in named if one in self.fields] if "__members__" in self.fields else []


def _annotated(body):
    found = [node for node in body if isinstance(node, ast.AnnAssign)]
    return {node.target.id: getattr(node.annotation, "id", "") for node in found}


def fitting(definition, arguments, named):
    """Refuse a call that does not fit the definition of a method."""
    signature = definition.args
    if signature.vararg:
        return
    names = [argument.arg for argument in signature.args[1:]]
    required = names[: len(names) - len(signature.defaults)]
    given = [*names[: len(arguments)], *named]
    fits = set(required) <= set(given) <= set(names) and len(given) == len(set(given)) and len(arguments) <= len(names)
    if not fits:
        message = f"{definition.name}({', '.join(names)}): called with {len(arguments)} arguments and {sorted(named)}"
        raise TypeError(message)


def structure(documented, made):
    """A class of plain values with exactly the fields of the stubs; those that are structures are there from the start.

    `made` has the classes by their names, once they are made.
    """
    init = documented.methods.get("__init__")

    class Structure:
        def __init__(self, *arguments, **named):
            if init is not None:
                fitting(init, arguments, named)
                order = [argument.arg for argument in init.args.args[1:]]
                for key, value in {**dict(zip(order, arguments)), **named}.items():
                    setattr(self, key, value)

        def __setattr__(self, key, value):
            if key not in documented.fields:
                raise Refused(documented.name, key)
            object.__setattr__(self, key, value)

        def __getattr__(self, key):
            if key not in documented.fields:
                raise Refused(documented.name, key)
            if documented.fields[key] not in made:
                raise NotPlayed(documented.name, key)
            value = made[documented.fields[key]]()
            object.__setattr__(self, key, value)
            return value

    return Structure


def played(documented, plays):
    """A class whose documented methods are played by functions; what is not documented cannot be played."""
    for name in plays:
        if name not in documented.methods:
            raise Refused(documented.name, name)

    class Played:
        def __getattr__(self, key):
            if key not in documented.methods:
                raise Refused(documented.name, key)
            if key not in plays:
                raise NotPlayed(documented.name, key)

            def call(*arguments, **named):
                fitting(documented.methods[key], arguments, named)
                return plays[key](*arguments, **named)

            return call

    return Played
