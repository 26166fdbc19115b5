"""Clouds come back from files as they were, whatever wrote them; what is broken is named and never crashes."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grasping import CloudError
from grasping.cloud_files import SUFFIXES, read_cloud, valid_points
from grasping.cloud_files.pcd import lzf_decompressed

POINTS = np.array([[0.1, -0.2, 0.5], [1.5, 0.25, 2.0], [3.0, -4.0, 5.0]], np.float32)
PLY = (
    "ply\nformat {} 1.0\ncomment made by hand\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\n"
)
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    "WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {}\n"
)
PCD_FIELDS = PCD.split("VIEWPOINT")[0].encode()


def rows(colour: str, order: str = "<") -> bytes:
    dtype = np.dtype([(axis, order + "f4") for axis in "xyz"] + [("colour", colour)])
    return np.array([(*row, 7) for row in POINTS.tolist()], dtype).tobytes()


def text() -> bytes:
    return "".join(f"{x} {y} {z} 7\n" for x, y, z in POINTS.tolist()).encode()


def literal_lzf(data: bytes) -> bytes:
    """LZF that copies nothing."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def compressed_pcd(table: bytes, packed: bytes | None = None) -> bytes:
    packed = literal_lzf(table) if packed is None else packed
    return np.array([len(packed), len(table)], "<u4").tobytes() + packed


COLUMNS = np.ascontiguousarray(POINTS.T).tobytes() + b"\7\0\0\0" * 3
FACE_FIRST = (
    b"ply\r\nformat binary_big_endian 1.0\r\nobj_info a mesh\r\nelement face 2\r\nproperty list uchar int index\r\n"
    b"property uchar flag\r\nelement vertex 3\r\nproperty short id\r\nproperty double z\r\nproperty double y\r\n"
    b"property double x\r\nend_header\r\n"
)
FACES = b"".join(bytes([n]) + np.arange(n, dtype=">i4").tobytes() + b"\1" for n in (3, 0))
BIG = np.array(
    [(1, z, y, x) for x, y, z in POINTS.tolist()], np.dtype([("i", ">i2"), ("z", ">f8"), ("y", ">f8"), ("x", ">f8")])
)
VERTEX_LISTS = (
    "ply\nformat {} 1\nelement vertex 3\nproperty list uchar short seen_by\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n"
)
LISTED = b"".join(bytes([k]) + b"\5\0" * k + POINTS[k].tobytes() for k in range(3))
LISTED_TEXT = "".join(f"{k} {'5 ' * k}{x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS.tolist())).encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("text.ply", PLY.format("ascii").encode() + b"end_header\n" + text()),
        ("tail.ply", PLY.format("binary_little_endian").encode() + b"element face 0\nend_header\n" + rows("u1")),
        ("big.PLY", FACE_FIRST + FACES + BIG.tobytes()),
        ("lists.ply", VERTEX_LISTS.format("binary_little_endian").encode() + LISTED),
        ("text_lists.ply", VERTEX_LISTS.format("ascii").encode() + LISTED_TEXT),
        (
            "faces_first.ply",
            b"ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int index\n"
            + PLY.format("ascii").split("by hand\n")[1].encode()
            + b"end_header\n3 0 1 2\n0\n"
            + text(),
        ),
        ("text.pcd", PCD.format("ascii").encode() + text()),
        ("binary.pcd", PCD.format("binary").encode() + rows("<u4")),
        ("compressed.pcd", PCD.format("binary_compressed").encode() + compressed_pcd(COLUMNS)),
        (
            "padded.pcd",
            b"VERSION .7\nFIELDS z _ y x\nSIZE 8 1 4 8\nTYPE F U F F\nCOUNT 1 3 1 1\nWIDTH 3\nDATA binary\n"
            + np.array(
                [(z, [0, 0, 0], y, x) for x, y, z in POINTS.tolist()],
                np.dtype([("z", "<f8"), ("_", "u1", 3), ("y", "<f4"), ("x", "<f8")]),
            ).tobytes(),
        ),
        ("plain.xyz", text()),
        ("commas.xyz", b"# from a scanner\nX,Y,Z,intensity\n" + text().replace(b" ", b", ") + b"// end\n"),
        ("counted.xyz", b"3\r\n" + text().replace(b"\n", b" ; # far\r\n")),
    ],
)
def test_points_come_back(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    cloud = read_cloud(tmp_path / name)
    assert cloud.dtype == np.float32
    np.testing.assert_array_equal(cloud, POINTS)


def test_lzf_copies_also_from_what_it_has_just_written() -> None:
    # "abc" as it is; 6 bytes from 3 before (overlapping); 10 bytes from 1 before, the length in a byte of its own.
    assert lzf_decompressed(b"\2abc" + b"\x80\2" + b"\xe0\1\0", 19) == b"abc" + b"abcabc" + b"c" * 10


def test_compressed_repetitions_of_an_organised_pcd_unfold(tmp_path: Path) -> None:
    header = PCD.format("binary_compressed").replace("WIDTH 3\nHEIGHT 1", "WIDTH 4\nHEIGHT 5").replace("S 3", "S 20")
    # 20 points of zeros: one byte as it is, then copies of up to 264 bytes of the byte before.
    packed = b"\0\0" + b"\xe0" + bytes([264 - 9]) + b"\0" + b"\xe0" + bytes([55 - 9]) + b"\0"
    (tmp_path / "zeros.pcd").write_bytes(header.encode() + compressed_pcd(bytes(320), packed))
    np.testing.assert_array_equal(read_cloud(tmp_path / "zeros.pcd"), np.zeros((5, 4, 3)))


def test_an_organised_cloud_keeps_its_rows_and_a_loose_one_drops_what_is_not_finite(tmp_path: Path) -> None:
    frame = np.zeros((2, 3, 3))
    frame[1] = POINTS
    frame[0, 0] = [np.nan, 1, 2]
    frame[0, 1] = [1, np.inf, 2]
    np.save(tmp_path / "frame.npy", frame)
    np.save(tmp_path / "loose.npy", np.asfortranarray(frame.reshape(-1, 3)))
    seen = read_cloud(tmp_path / "frame.npy")
    assert np.isnan(seen[0, :2]).all()
    np.testing.assert_array_equal(seen[1], POINTS)
    np.testing.assert_array_equal(valid_points(seen), POINTS)
    np.testing.assert_array_equal(read_cloud(tmp_path / "loose.npy"), [[0, 0, 0], *POINTS])
    header = PCD.format("ascii").replace("WIDTH 3\nHEIGHT 1", "WIDTH 1\nHEIGHT 3")
    (tmp_path / "frame.pcd").write_bytes(header.encode() + text().replace(b"1.5", b"nan"))
    np.testing.assert_array_equal(read_cloud(tmp_path / "frame.pcd"), POINTS[[0, 2]])  # one column is no image


def test_an_archive_is_searched_by_name_and_then_by_shape(tmp_path: Path) -> None:
    other = np.ones((4, 3))
    for arrays in (
        {"other": other, "xyz": POINTS, "points": POINTS[:2]},
        {"other": other, "xyz": POINTS[:2]},
        {"label": np.zeros(3), "cloud": POINTS[:2]},
        {"points": np.rec.fromarrays(POINTS[:2].T, names="x,y,z")},
    ):
        np.savez_compressed(tmp_path / "a.npz", **arrays)
        np.testing.assert_array_equal(read_cloud(tmp_path / "a.npz"), POINTS[:2])


@pytest.mark.parametrize("unit", [np.uint16, np.float32])
def test_depth_with_intrinsics_becomes_a_frame_in_metres(tmp_path: Path, unit: type) -> None:
    depth = np.array([[0, 500, 1000], [2000, 0, 1500]]) / (1 if unit is np.uint16 else 1000)
    k = np.array([[4, 0, 1], [0, 2, 0.5], [0, 0, 1]])
    np.savez(tmp_path / "frame.npz", depth=depth.astype(unit), K=k)
    frame = read_cloud(tmp_path / "frame.npz")
    assert frame.shape == (2, 3, 3)
    assert np.isnan(frame[0, 0]).all()
    np.testing.assert_allclose(frame[0, 2], [0.25, -0.25, 1.0], rtol=1e-6)
    np.testing.assert_allclose(frame[1, 0], [-0.5, 0.5, 2.0], rtol=1e-6)


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def npy_header(shape: tuple[int, ...]) -> bytes:
    """A file that ends where the numbers would begin."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return buffer.getvalue()


def npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


ASCII_PLY, ASCII_PCD = PLY.format("ascii").encode() + b"end_header\n", PCD.format("ascii").encode()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("solid.ply", b"solid\nend_header\n", "does not begin with 'ply'"),
        ("few.ply", ASCII_PLY + b"0 0 0 7\n", "promises 3 rows of vertex and holds 1"),
        ("word.ply", ASCII_PLY + b"0 0 0 7\n0 far 0 7\n0 0 0 7\n", "line 11: 'far' is not a number"),
        ("short.ply", ASCII_PLY + b"0 0 0 7\n0 0 0 7\n0 0\n", "line 12 holds 2 numbers, and a vertex has 4"),
        ("open.ply", b"ply\nformat ascii 1.0\n", "no end_header"),
        ("flat.ply", ASCII_PLY.replace(b"float z", b"float depth"), "no number z"),
        ("type.ply", ASCII_PLY.replace(b"float z", b"quad z"), "line 7: 'property quad z'"),
        ("mesh.ply", FACE_FIRST + FACES[:5], "ends in face 0, within index"),
        ("cut.ply", FACE_FIRST + FACES + BIG.tobytes()[:-1], "3 of vertex need 78 bytes, and 77 are there"),
        ("cut.pcd", PCD.format("binary").encode() + b"\0" * 20, "need 48 bytes, and 20 are there"),
        ("zip.pcd", PCD.format("binary_zipped").encode(), "line 11: DATA binary_zipped"),
        ("size.pcd", PCD.format("binary_compressed").encode() + compressed_pcd(b"1"), "need 48 bytes, and 1 are"),
        (
            "copy.pcd",
            PCD.format("binary_compressed").encode() + compressed_pcd(COLUMNS, b"\x20\0"),
            "before their beginning",
        ),
        ("shape.pcd", ASCII_PCD.replace(b"WIDTH 3", b"WIDTH 2"), "POINTS 3 is not WIDTH 2 × HEIGHT 1"),
        ("field.pcd", ASCII_PCD.replace(b"FIELDS x y", b"FIELDS x v"), "no field y"),
        ("sizes.pcd", ASCII_PCD.replace(b"SIZE 4 4 4 4", b"SIZE 4 4 4"), "SIZE 4 4 4: expected 4 whole numbers"),
        ("type.pcd", ASCII_PCD.replace(b"SIZE 4", b"SIZE 3"), "field x: there is no TYPE F of SIZE 3"),
        ("word.pcd", ASCII_PCD + b"0 0 0 7\n0 0 z 7\n0 0 0 7\n", "line 13: 'z' is not a number"),
        ("word.xyz", b"# far\n1 2 3\n1 2 three\n", "line 3: field z: 'three' is not a number"),
        ("short.xyz", b"1 2 3\n1 2\n", "line 2 has 2 columns, line 1 has 3"),
        ("counted.xyz", b"3\n1 2 3\n", "promises 3 points, and 1 follow"),
        ("shape.npy", npy(np.zeros((4, 2))), r"shape \(4, 2\)"),
        ("text.npy", npy(np.array([["a", "b", "c"]])), "<U1"),
        ("pickle.npy", npy(np.array([[{}, 1, 2]])), "Python objects"),
        ("pickle.npz", npz(points=np.array([[{}, 1, 2]])), "array 'points': it holds Python objects"),
        ("cut.npy", npy(POINTS)[:-1], r"shape \(3, 3\) needs 36 bytes, and 35 are there"),
        (
            "vast.npy",
            npy_header((10**12, 3)),
            r"shape \(1000000000000, 3\) needs 12000000000000 bytes, and 0 are there",
        ),
        ("less.npy", npy_header((-1, 3)), r"not a readable .npy: its shape is \(-1, 3\)"),
        ("rows.npy", npy_header((10**30, 0)), "not a readable .npy"),
        ("torn.npy", npy(POINTS).replace(b"}", b" "), "not a readable .npy"),
        ("newer.npy", b"\x93NUMPY\x09\x00" + npy(POINTS)[8:], "not a readable .npy"),
        ("words.npy", b"not a file of numpy's", "not a readable .npy"),
        ("none.npz", npz(label=np.zeros(3)), r"no array of shape .* among label \(3,\)"),
        ("two.npz", npz(colors=POINTS, cloud=POINTS), "the cloud may be any of colors, cloud; name it 'points'"),
        ("bare.npz", npz(depth=np.zeros((2, 2))), "intrinsics"),
        ("lens.npz", npz(depth=np.ones((2, 2)), K=np.diag([0, 0, 1])), "focal lengths 0 and 0"),
        ("zip.npz", b"PK\3\4" + b"\0" * 40, "not a readable .npz"),
        ("mesh.obj", b"", r"read from \.npy, \.npz, \.pcd, \.ply, \.xyz, .*, not \.obj"),
    ],
)
def test_what_is_broken_is_named_with_its_file(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CloudError, match=f"{name}: .*{message}"):
        read_cloud(tmp_path / name)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nothing\.ply does not exist"):
        read_cloud(tmp_path / "nothing.ply")


SEEDS = [
    (".ply", PLY.format("ascii").encode() + b"end_header\n" + text()),
    (".ply", FACE_FIRST + FACES + BIG.tobytes()),
    (".ply", VERTEX_LISTS.format("binary_little_endian").encode() + LISTED),
    (".ply", VERTEX_LISTS.format("ascii").encode() + LISTED_TEXT),
    (".pcd", ASCII_PCD + text()),
    (".pcd", PCD.format("binary").encode() + rows("<u4")),
    (".pcd", PCD.format("binary_compressed").encode() + compressed_pcd(COLUMNS)),
    (".xyz", text()),
    (".csv", b'x,y,z,"r"\n' + text().replace(b" ", b",")),
    (".ply", PLY.format("ascii").encode() + b"end_header\n" + text().replace(b" 7", b"\n7")),
    (".npy", npy(POINTS)),
    (".npz", npz(points=POINTS)),
    (".npz", npz(depth=np.ones((2, 2)), K=np.array([[2.0, 0, 1], [0, 2, 1], [0, 0, 1]]))),
]


def one_way_or_the_other(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        cloud = read_cloud(path)
    except CloudError as error:
        cloud, message = None, str(error)
    if cloud is None:
        assert message.startswith(f"{path}: ")
    else:
        assert cloud.dtype == np.float32
        assert cloud.shape[-1] == 3
        assert cloud.ndim == 3 or np.isfinite(cloud).all()


@pytest.mark.filterwarnings("error")
@given(st.data())
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path, data: st.DataObject) -> None:
    suffix, content = data.draw(st.sampled_from(SEEDS))
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged)))
        length = data.draw(st.integers(0, 8))
        damaged[at : at + length] = data.draw(
            st.binary(max_size=8) | st.sampled_from([b"-1", b"9" * 12, b"\n", b"nan"])
        )
    if data.draw(st.booleans()):
        del damaged[data.draw(st.integers(0, len(damaged))) :]
    one_way_or_the_other(tmp_path / f"cloud{suffix}", bytes(damaged))


@pytest.mark.filterwarnings("error")
@given(st.sampled_from(SUFFIXES), st.binary(max_size=200))
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_read_or_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    one_way_or_the_other(tmp_path / f"cloud{suffix}", content)


def test_an_archive_with_a_damaged_member_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", npy(np.zeros((100, 3))))
    content = bytearray((tmp_path / "a.npz").read_bytes())
    content[60:70] = b"\xff" * 10
    one_way_or_the_other(tmp_path / "b.npz", bytes(content))
    with pytest.raises(CloudError, match="not a readable"):
        read_cloud(tmp_path / "b.npz")


def test_a_real_mesh_is_read() -> None:
    data = Path(__file__).resolve().parents[4] / "shared" / "data"
    if not data.is_dir():
        pytest.skip(f"no real data at {data}")
    points = read_cloud(data / "meshes/ycb5/mug/025_mug.ply")
    assert len(points) > 1000
    assert 0.05 < np.ptp(points, axis=0).max() < 0.2
