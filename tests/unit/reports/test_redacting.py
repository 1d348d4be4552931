"""Test that no text for strangers names a machine, its people or their secrets."""

from __future__ import annotations

import pytest

from harness.reports.issue import redacting

WORDS = {"/home/jane": "~", "jane": "<user>", "gpu-node-07": "<host>", "pypi.acme.example": "<index>"}


@pytest.mark.parametrize(
    ("text", "left"),
    [
        # folders
        (
            'File "/home/jane/venv/lib/python3.9/site-packages/gym/core.py", line 3',
            'File "…/site-packages/gym/core.py", line 3',
        ),
        ('File "/opt/conda/envs/rl/lib/python3.10/copy.py", line 3', 'File "…/lib/python3.10/copy.py", line 3'),
        ("cannot open /home/jane/work/secret project/model.xml", "cannot open <path>/secret project/model.xml"),
        ("cannot open /data/acme-lab/robots/arm.urdf: no such file", "cannot open <path>/arm.urdf: no such file"),
        ("cannot open /mnt/nfs/x", "cannot open <path>/x"),
        ("in /Users/jane/rl/train.py", "in <path>/train.py"),
        ("in ~/rl/train.py", "in <path>/train.py"),
        (r"in C:\Users\Jane Doe\rl\train.py", r"in <path>\train.py"),
        ("HOME=/home/someone-else", "HOME=<path>/someone-else"),
        ("in /tmp", "in <path>"),
        # people and hosts
        ("by jane on gpu-node-07", "by <user> on <host>"),
        ("mail jane.doe+rl@acme.example.org", "mail <email>"),
        ("connect to 10.2.3.4 failed", "connect to <address> failed"),
        ("connect to 203.0.113.9:8080 failed", "connect to <address>:8080 failed"),
        ("host build.acme.internal is down", "host <host> is down"),
        ("from https://pypi.acme.example/simple/gym/", "from https://<index>/simple/gym/"),
        # secrets
        ("WANDB_API_KEY=0123abcd", "WANDB_API_KEY=<redacted>"),
        ("HF_TOKEN: 'hf_abc'", "HF_TOKEN: '<redacted>'"),
        ("{'password': 'letmein', 'user': 1}", "{'password': '<redacted>', 'user': 1}"),
        ("https://bob:pa55@files.example.org/a.whl", "https://<redacted>@files.example.org/a.whl"),
        (
            "https://files.example.org/a.whl?X-Signature=abc&token=def",
            "https://files.example.org/a.whl?X-Signature=<redacted>&token=<redacted>",
        ),
        ("Authorization: Bearer abcdef0123456789", "Authorization: <redacted>"),
        ("sent Bearer abcdef0123456789", "sent Bearer <redacted>"),
        ("key ghp_" + "a1" * 18, "key <redacted>"),
        ("key AKIA" + "ABCD" * 4, "key <redacted>"),
        ("-----BEGIN RSA PRIVATE KEY-----\nMIIE\n-----END RSA PRIVATE KEY-----\nafter", "<redacted>\nafter"),
    ],
)
def test_private_names_are_taken_out(text: str, left: str) -> None:
    """Paths keep the part that says something, names and secrets go."""
    assert redacting.redact(text, WORDS) == left


@pytest.mark.parametrize(
    "text",
    [
        "AttributeError: module 'numpy' has no attribute 'bool8'",
        "ValueError: XML Error: bad / Element 'default', line 0",
        "https://github.com/Farama-Foundation/Gymnasium/issues/749",
        "see https://mujoco.readthedocs.io/en/stable/python.html#building-from-source.",
        'File "…/site-packages/gym/core.py", line 3, in step',
        "/usr/lib/x86_64-linux-gnu/libEGL.so.1: undefined symbol",
        "/usr/include/python3.9/Python.h: no such file",
        "opencv-python 4.11.0.86 and mujoco 3.3.7",
        "bound to 127.0.0.1:8080",
        "dm_control:cheetah/run, 1/2, and/or, n/a",
        "Bazel //labmaze/cc/python:_defaults",
        "numpy==2.2.6 \\\n    --hash=sha256:" + "0a" * 32,
        "TypeError: reset() got an unexpected keyword argument 'seed'",
        "the author: nobody; authentication failed",
        "janet and gpu-node-071",
    ],
)
def test_needed_details_stay(text: str) -> None:
    """Nothing of what an upstream needs is lost: lines, links, system libraries, versions, hashes."""
    assert redacting.redact(text, WORDS) == text


@pytest.mark.parametrize(
    ("name", "is_it"),
    [("WANDB_API_KEY", True), ("hf_token", True), ("MY_PASSWORD", True), ("MUJOCO_GL", False), ("DISPLAY", False)],
)
def test_variables_whose_value_nobody_should_read(name: str, is_it: bool) -> None:
    """Secret variables are recognised by their names."""
    assert redacting.secret(name) is is_it
