"""Names of a module in C, by the tables in its source."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from harness.history import c_names
from harness.history.package_plan import PackagePlan

SOURCE = r"""
/* {"inAComment", toy_none, METH_VARARGS, ""}, */
static PyMethodDef BodyMethods[] = {{"mass", body_mass, METH_NOARGS, "Of a class."}, {NULL}};

static PyMethodDef ToyMethods[] = {
    {"loadModel", (PyCFunction)toy_load, METH_VARARGS | METH_KEYWORDS,
     "loadModel(\"name\"); see http://example.invalid // };\n"
#ifdef WITH_ARRAYS
     " as \
       arrays"
#endif
    },
    // {"gone", toy_gone, METH_VARARGS, "Out of use"},
    {  "step" ,toy_step, METH_VARARGS, "Step."},
    {"_hidden", toy_hidden, METH_VARARGS, ""},
#if 0
    {"planned", toy_planned, METH_VARARGS, ""},
#elif defined(WITH_SOFT_BODIES)
    {"loadSoftBody", toy_soft, METH_VARARGS, ""},
#else
    {"loadRigidBody", toy_rigid, METH_VARARGS, ""},
#endif
#ifndef WITHOUT_RAYS
    {"castRay", toy_ray, METH_VARARGS, ""},
#endif
    {NULL, NULL, 0, NULL}};

#if PY_MAJOR_VERSION >= 3
static struct PyModuleDef moduledef = {PyModuleDef_HEAD_INIT, "toy", /* name */ "Help };", -1, ToyMethods, NULL};
#endif

PyMODINIT_FUNC PyInit_toy(void) {
    PyObject* m = PyModule_Create(&moduledef);
    PyModule_AddIntConstant(m, "GUI", eGUI);
    PyModule_AddIntConstant(m,
                            "SHARED_MEMORY_KEY", KEY);
    PyModule_AddIntMacro(m, TOY_VERSION);
    /* PyModule_AddIntConstant(m, "NEVER", 1); */
#ifdef WITH_ARRAYS
#if defined(WITH_GPU) && !defined(WITHOUT_RAYS)
    PyModule_AddIntConstant(m, "GPU", 1);
#endif
    PyModule_AddStringConstant(m, "ARRAYS", "numpy");
#endif
    ToyError = PyErr_NewException((char*)"toy.error", NULL, NULL);
    PyModule_AddObject(m, "error", ToyError);
}
"""

ALWAYS = ["GUI", "SHARED_MEMORY_KEY", "TOY_VERSION", "castRay", "error", "loadModel", "loadRigidBody", "step"]


def names(*defined: str) -> list[str]:
    """Return the names that the module has if these macros are defined."""
    return c_names.read("toy", SOURCE, defined)["names"]["toy"]  # type: ignore[no-any-return]


def test_functions_constants_and_exceptions_of_a_module_are_its_names() -> None:
    """Tables of classes, comments, branches that are left out and private names do not count."""
    assert names() == ALWAYS
    assert c_names.read("toy", SOURCE)["members"] == {"toy.error": ["args", "with_traceback"]}


def test_macros_decide_on_branches() -> None:
    """A branch within a branch needs both; of `#if` and `#elif` the first that holds is taken."""
    assert {*names("WITH_ARRAYS")} == {*ALWAYS, "ARRAYS"}
    assert {*names("WITH_ARRAYS", "WITH_GPU")} == {*ALWAYS, "ARRAYS", "GPU"}
    assert {*names("WITH_GPU", "WITHOUT_RAYS")} == {*ALWAYS} - {"castRay"}
    assert {*names("WITH_SOFT_BODIES")} == {*ALWAYS, "loadSoftBody"} - {"loadRigidBody"}


def test_macros_are_read_from_the_build_script() -> None:
    """Options in a comment define nothing."""
    script = "flags = '-DWITH_ARRAYS -DSIZE=3 '\n#flags += '-DWITH_GPU '\nflags += '-DLINUX'  # not -DBSD\n"
    assert c_names.macros(script) == {"WITH_ARRAYS", "SIZE", "LINUX"}


def test_the_module_of_python_2_is_read_as_well() -> None:
    """It names its table in a call."""
    source = (
        'PyMethodDef Some[] = {{"run", run, 1, ""}, {0}};\nvoid inittoy() { Py_InitModule3("toy", Some, "(Help)"); }'
    )
    assert c_names.read("toy", source)["names"] == {"toy": ["run"]}


def test_a_source_without_the_table_of_a_module_is_refused() -> None:
    """Its names would all seem to be gone."""
    with pytest.raises(ValueError, match="no table of the functions of toy"):
        c_names.read("toy", 'static PyMethodDef Some[] = {{"run", run, 1, ""}, {0}};')


def test_an_sdist_has_the_modules_that_it_installs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its module in C is one of machine code, scripts outside of packages are none; lines may end as on Windows."""

    def run(*_: object, **__: object) -> None:
        raise FileNotFoundError  # griffe asks git about each package that it loads

    monkeypatch.setattr(subprocess, "run", run)
    sources = {
        "setup.py": "flags = '-DWITH_ARRAYS'",
        "code/toy.c": SOURCE,
        "code/python/toy_envs/__init__.py": "def make(): ...\n",
        "code/python/toy_envs/scripts/train.py": "def main(): ...\n",
        "code/python/toy.egg-info/PKG-INFO": "Name: toy\n",
        "code/python/toy.egg-info/requires.txt": "numpy\n",
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, newline="\r\n")
    plan = PackagePlan(imports=("toy", "toy_envs"), c_sources={"toy": "code/toy.c"}, source_root="code/python")
    facts, answers = c_names.read_release(tmp_path, plan)
    assert (facts.modules, facts.natives) == (("toy", "toy_envs"), ("toy",))
    assert facts.names == {"toy_envs": ("make",)}
    assert facts.requires == ("numpy",)
    assert {*answers["names"]["toy"]} == {*ALWAYS, "ARRAYS"}
    assert [*answers["members"]] == ["toy.error"]
