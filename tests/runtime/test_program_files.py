"""Files of compiled programs: read only as they were written, and only where no other user may write."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dvr_jax.runtime import program_files
from dvr_jax.runtime.program_files import cache_folder, is_private, read_entry, write_entry

CONTENT = bytes(range(256)) * 3


@pytest.fixture
def entry(tmp_path: Path) -> Path:
    path = tmp_path / "cache" / "programs-1" / "a.executable"
    write_entry(path, CONTENT)
    return path


def test_what_was_written_is_read(entry: Path) -> None:
    assert read_entry(entry) == CONTENT


def test_every_changed_byte_is_noticed(entry: Path) -> None:
    whole = entry.read_bytes()
    for place in range(len(whole)):
        entry.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        assert read_entry(entry) is None
    for end in range(len(whole)):
        entry.write_bytes(whole[:end])
        assert read_entry(entry) is None


def test_a_program_is_not_taken_for_another_one(entry: Path) -> None:
    entry.rename(entry.with_name("b.executable"))
    assert read_entry(entry.with_name("b.executable")) is None


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("mode", [0o777, 0o722])
def test_where_others_may_write_nothing_is_read(entry: Path, place: int, mode: int) -> None:
    """The file, its folder, and the folder above."""
    (entry, *entry.parents)[place].chmod(mode)
    assert read_entry(entry) is None


def test_where_others_may_write_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    write_entry(tmp_path / "cache" / "programs-1" / "a.executable", CONTENT)
    assert list(tmp_path.rglob("*.executable")) == []


def test_a_folder_of_another_user_is_not_read(entry: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getuid", lambda: 12_345)
    assert (os.stat(entry).st_uid in (0, 12_345)) == is_private(entry)
    monkeypatch.setattr(program_files, "_is_foreign", lambda status: True)
    assert read_entry(entry) is None


def test_new_folders_are_the_users_own(entry: Path) -> None:
    assert entry.parent.stat().st_mode & 0o777 == 0o700


def test_many_may_fill_one_cache_at_the_same_time(tmp_path: Path) -> None:
    path = tmp_path / "cache" / "programs-1" / "a.executable"
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: write_entry(path, CONTENT), range(50)))
    assert read_entry(path) == CONTENT


@pytest.mark.parametrize(
    ("variables", "folder"),
    [
        ({"DVR_JAX_CACHE": "off"}, None),
        ({"DVR_JAX_CACHE": "/a"}, Path("/a")),
        ({"XDG_CACHE_HOME": "/b"}, Path("/b/dvr_jax")),
        ({"XDG_CACHE_HOME": "relative"}, None),
        ({"HOME": "/c"}, Path("/c/.cache/dvr_jax")),
        ({"HOME": ""}, None),
    ],
)
def test_where_the_cache_is(
    variables: dict[str, str], folder: Path | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DVR_JAX_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert cache_folder() == folder


def test_without_a_home_and_without_an_entry_of_the_user_there_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import pwd

    def unknown(number: int) -> None:
        raise KeyError(number)

    for name in ("DVR_JAX_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert cache_folder() is None
