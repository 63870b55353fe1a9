"""Text files that a user names: what is no text, no file or without end gives one sentence, at once."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path

import pytest

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.text import LARGEST_TABLE_BYTES, json_of, text_of, toml_of

MIB = 2**20


def refused(call, *words: str) -> None:
    """It ends within seconds, with one short sentence that holds the words."""
    begin = time.perf_counter()
    with pytest.raises(InputError) as caught:
        call()
    sentence = str(caught.value)
    assert time.perf_counter() - begin < 5.0
    assert len(sentence) < 600 and "\n" not in sentence and sentence.endswith("."), sentence
    for word in words:
        assert word in sentence, sentence


def test_text_is_read_without_its_mark(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('title = "è"\r\n', encoding="utf-8-sig")
    assert toml_of(text_of(path, "give a file"), path) == {"title": "è"}
    (tmp_path / "link.toml").symlink_to(path)
    assert text_of(tmp_path / "link.toml", "give a file").startswith("title")


def test_what_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # The name of a socket must be short.
    os.mkfifo("pipe")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        (tmp_path / "loop").symlink_to("loop")
        for name, word in (
            ("/dev/zero", "a device"),
            ("pipe", "a pipe"),
            (tmp_path, "a folder"),
            ("socket", "cannot be read"),
            ("loop", "symbolic links"),
            ("none.toml", "No such file"),
            ("x" * 300, "too long"),
            ("a\0b", "a\\x00b"),
        ):
            refused(lambda name=name: text_of(name, "give a file"), word, "give a file")


def test_what_is_too_large_or_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    with path.open("wb") as file:
        file.truncate(50 * 2**30)  # A hole: it has this size, and takes no room.
    refused(lambda: text_of(path, "give a smaller one"), "51200 MiB", "4 MiB", "a smaller one")
    path.write_bytes("title = 'x'\n".encode("utf-16"))
    refused(lambda: text_of(path, "give a file"), "line 1", "UTF-8")
    path.write_bytes(b"title = 'x'\nname = '\xff'\n")
    refused(lambda: text_of(path, "give a file"), "line 2", "UTF-8")


DEEP = {
    "brackets": "a = " + "[" * MIB,
    "closed brackets": "a = " + "[" * 400 + "]" * 400,
    "tables in a line": "a = " + "{a = " * MIB,
    "a key of parts": ".".join("a" * (LARGEST_TABLE_BYTES // 2)) + " = 1",
    "a key of quoted parts": ". ".join(['"a"'] * 100_000) + " = 1",
    "a head of parts": "[" + ".".join("a" * 200) + "]",
}


@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP)
def test_tables_in_tables(text: str) -> None:
    refused(lambda: toml_of(text, "a.toml"), "a.toml", "more than 32")


def test_lists_in_lists() -> None:
    refused(lambda: json_of("[" * MIB, "a.json"), "a.json", "more than 32")
    refused(lambda: json_of("[" * 100 + "]" * 100, "a.json"), "more than 32")
    refused(lambda: json_of("[1,", "a.json"), "a.json", "not valid JSON")


@pytest.mark.parametrize("text", ["a = " + "1" * MIB, "a" * MIB, '"' * MIB, "a." + " " * MIB, "a = " + "." * MIB, "\0"])
def test_what_is_no_toml(text: str) -> None:
    refused(lambda: toml_of(text, "a.toml"), "a.toml", "not valid TOML")
