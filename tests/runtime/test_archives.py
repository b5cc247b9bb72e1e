"""Archives of arrays: what is read is what was written, or the archive is refused."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dvr_jax.runtime.archives import read_arrays
from dvr_jax.runtime.json_text import parse_json

ARRAYS = {
    "floats": np.random.default_rng(0).normal(size=(7, 3)),
    "integers": np.arange(5),
    "transposed": np.arange(12.0).reshape(3, 4).T,
    "text": np.array("a text"),
    "nothing": np.zeros((0, 4)),
    "number": np.array(3.0),
}


def written(path: Path, compressed: bool = False) -> bytes:
    (np.savez_compressed if compressed else np.savez)(path, **ARRAYS)  # type: ignore[arg-type]
    return path.read_bytes()


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_come_back(compressed: bool, tmp_path: Path) -> None:
    written(tmp_path / "a.npz", compressed)
    found = read_arrays(tmp_path / "a.npz")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array)
        assert found[name].flags.writeable


@pytest.mark.parametrize("compressed", [False, True])
def test_every_byte_that_is_changed_is_noticed_or_does_not_matter(
    compressed: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.npz"
    whole = written(path, compressed)
    noticed = 0
    for place in range(0, len(whole), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        path.write_bytes(damaged)
        try:
            found = read_arrays(path)
        except ValueError:
            noticed += 1
            continue
        assert all(np.array_equal(found[name], array) for name, array in ARRAYS.items())
        assert found.keys() == ARRAYS.keys()
    assert noticed > len(whole) / 3 / 2


def archive(path: Path, header: str, data: bytes = bytes(8)) -> Path:
    """An archive with one array of a given header."""
    text = header.encode() + b"\n"
    entry = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("a.npy", entry)
    return path


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (10**14,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000000,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 100000000000000000000000), }",
        "{'descr': '|V0', 'fortran_order': False, 'shape': (100000000000000,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }",
        "(" * 5000,
        "[" * 500 + "]" * 500,
        "-" * 9000 + "1",
        "",
    ],
)
def test_hostile_headers_are_refused(header: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError):
        read_arrays(archive(tmp_path / "a.npz", header))


def test_archives_that_grow_are_refused_before_they_do(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, zeros=np.zeros(10_000_000))
    with pytest.raises(ValueError, match="80,000,128 bytes; valid are at most 1,000,000"):
        read_arrays(path, 1_000_000)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for content in (b"", b"text", io.BytesIO().getvalue(), b"\x93NUMPY\x01\x00"):
        path.write_bytes(content)
        with pytest.raises(ValueError):
            read_arrays(path)


@pytest.mark.parametrize("text", ["[" * 100_000, b"\xff\xfe{\x00", "", "NaN", "1" * 5000, b"\xe9"])
def test_whatever_is_wrong_with_json_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError):
        parse_json(text)
