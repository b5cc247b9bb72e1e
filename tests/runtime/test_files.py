"""Files: whole or absent, named when they cannot be used, and never waited for or read without end."""

import errno
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dvr_jax.runtime import files
from dvr_jax.runtime.files import (
    append_line,
    read_whole,
    require_folder,
    require_writable,
    write_together,
    write_whole,
)


@pytest.fixture
def small_disk() -> Iterator[None]:
    """A disk on which no file may have more than 4 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_that_does_not_fit_is_named_and_leaves_the_old_one(
    tmp_path: Path, small_disk: None
) -> None:
    path = tmp_path / "result"
    write_whole(path, b"old")
    with pytest.raises(OSError) as refused:
        write_whole(path, bytes(10_000))
    assert refused.value.filename == str(path) and refused.value.errno == errno.EFBIG
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_files_that_belong_together_are_replaced_together(tmp_path: Path) -> None:
    write_together(tmp_path, {"a": b"1", "b": b"1", "c": b"1"}, last="c")
    write_together(tmp_path, {"a": b"2", "c": b"2"}, last="c", stale=("a", "b"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"2", "c": b"2"}


def test_of_files_that_belong_together_none_is_replaced_unless_all_fit(
    tmp_path: Path, small_disk: None
) -> None:
    old = {"a": b"1", "b": b"1", "c": b"1"}
    write_together(tmp_path, old, last="c")
    with pytest.raises(OSError) as refused:
        write_together(tmp_path, {"a": b"2", "b": bytes(10_000), "c": b"2"}, last="c")
    assert refused.value.filename == str(tmp_path / "b")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == old


def test_the_last_file_goes_first_and_comes_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_together(tmp_path, {"plan": b"1", "motion": b"1"}, last="plan")
    replaced: list[str] = []
    replace = os.replace

    def watch(source: Path, target: Path) -> None:
        assert not (tmp_path / "plan").exists()
        replaced.append(target.name)
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", watch)
    write_together(tmp_path, {"plan": b"2", "motion": b"2"}, last="plan")
    assert replaced == ["motion", "plan"]


def test_a_line_that_does_not_fit_leaves_the_file_as_it_was(
    tmp_path: Path, small_disk: None
) -> None:
    path = tmp_path / "history"
    append_line(path, "first\n")
    with pytest.raises(OSError) as refused:
        append_line(path, "x" * 10_000 + "\n")
    assert refused.value.filename == str(path)
    append_line(path, "last\n")
    assert path.read_text() == "first\nlast\n"


def test_a_link_leads_to_the_file_that_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(tmp_path / "link", b"content")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "file").read_bytes() == b"content"


def test_what_is_no_regular_file_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    require_writable(pipe)
    write_whole(pipe, b"content")
    reader.join()
    assert read == [b"content"] and pipe.is_fifo()


def test_the_longest_name_that_a_file_may_have(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 255)
    write_whole(path, b"content")
    assert path.read_bytes() == b"content"


@pytest.mark.parametrize("require", [require_folder, lambda folder: require_writable(folder / "f")])
def test_a_full_disk_is_found_out_before_the_work(
    require: object, tmp_path: Path, small_disk: None
) -> None:
    assert callable(require)
    with pytest.raises(OSError) as refused:
        require(tmp_path / "out")
    assert refused.value.filename == str(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_folder_is_no_place_for_a_file(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        require_writable(tmp_path)


def test_pipes_devices_and_large_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(bytes(11))
    for path, reason in {
        tmp_path / "pipe": "it is no regular file",
        Path("/dev/zero"): "it is no regular file",
        tmp_path: "Is a directory",
        tmp_path / "large": "it is larger than 10 bytes",
        tmp_path / "absent": "No such file or directory",
    }.items():
        with pytest.raises(OSError) as refused:
            read_whole(path, 10)
        assert (refused.value.filename, refused.value.strerror) == (str(path), reason)


def test_what_a_shell_has_opened_is_read() -> None:
    code = "from dvr_jax.runtime.files import read_whole; print(read_whole('/dev/stdin', 9))"
    ended = subprocess.run([sys.executable, "-c", code], input=b"piped", capture_output=True)
    assert ended.stdout == b"b'piped'\n", ended.stderr
