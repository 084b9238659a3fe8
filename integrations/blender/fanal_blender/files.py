"""Files that appear whole or not at all, and the formats that fanal reads: PLY meshes and OpenEXR pictures."""

import os
import struct
import tempfile
import zlib

import numpy as np

# Rows of an EXR file that are packed together (ZIP).
_BLOCK = 16


def write_bytes(path, data):
    """Writes `data` to a temporary file beside `path` and renames it."""
    folder = os.path.dirname(path) or "."
    handle, temporary = tempfile.mkstemp(dir=folder, prefix=".", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        # mkstemp makes files that others may not read.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def ply(positions, triangles, normals=None, uvs=None):
    """A binary PLY file: positions (n, 3), triangles (m, 3), and where given normals (n, 3) and texture coordinates (n, 2)."""
    parts = [("xyz", positions)]
    if normals is not None:
        parts.append((("nx", "ny", "nz"), normals))
    if uvs is not None:
        parts.append(("uv", uvs))
    names = [name for names, _ in parts for name in names]
    vertices = np.concatenate([np.asarray(values, "<f4") for _, values in parts], axis=1)
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = triangles
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(lines).encode() + np.ascontiguousarray(vertices, "<f4").tobytes() + faces.tobytes()


def exr(pixels, half=True):
    """An OpenEXR file of `pixels` (rows from the top, columns, 1 or 3 channels), linear, packed with ZIP."""
    pixels = np.asarray(pixels, np.float32)
    if half:
        pixels = np.clip(pixels, -65504.0, 65504.0)
    rows, columns, channels = pixels.shape
    kind, code = ("<f2", 1) if half else ("<f4", 2)
    # Channels are stored in the order of their names: B, G, R.
    planes = pixels[:, :, [2, 1, 0] if channels == 3 else [0, 0, 0]].astype(kind).transpose(0, 2, 1)
    channel_list = b"".join(name + b"\0" + struct.pack("<iB3xii", code, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    box = struct.pack("<iiii", 0, 0, columns - 1, rows - 1)
    header = struct.pack("<II", 20000630, 2)
    for name, type_name, value in [
        (b"channels", b"chlist", channel_list),
        (b"compression", b"compression", b"\x03"),
        (b"dataWindow", b"box2i", box),
        (b"displayWindow", b"box2i", box),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1.0)),
        (b"screenWindowCenter", b"v2f", struct.pack("<ff", 0.0, 0.0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1.0)),
    ]:
        header += name + b"\0" + type_name + b"\0" + struct.pack("<i", len(value)) + value
    header += b"\0"
    blocks = []
    for first in range(0, rows, _BLOCK):
        packed = _zip(planes[first : first + _BLOCK].tobytes())
        blocks.append(struct.pack("<ii", first, len(packed)) + packed)
    offsets, place = [], len(header) + 8 * len(blocks)
    for block in blocks:
        offsets.append(place)
        place += len(block)
    return header + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(blocks)


def _zip(raw):
    """EXR's ZIP: bytes at even places first, then differences, then DEFLATE; as it was where that is not smaller."""
    data = np.frombuffer(raw, np.uint8)
    data = np.concatenate([data[0::2], data[1::2]]).astype(np.int16)
    data[1:] = data[1:] - data[:-1] + 128
    packed = zlib.compress((data & 0xFF).astype(np.uint8).tobytes(), 6)
    return packed if len(packed) < len(raw) else raw


def picture_kind(head):
    """The format that a picture's first bytes tell, of those that fanal reads: a file name's ending, or None."""
    for magic, ending in [
        (b"\x89PNG", ".png"),
        (b"\xff\xd8\xff", ".jpg"),
        (b"\x76\x2f\x31\x01", ".exr"),
        (b"BM", ".bmp"),
        (b"#?", ".hdr"),
    ]:
        if head.startswith(magic):
            return ending
    return None


def is_plain_exr(data):
    """Whether an EXR file has one part of flat scan lines or tiles, in a compression that is not DWA."""
    flags = struct.unpack_from("<I", data, 4)[0]
    place = data.find(b"compression\0compression\0")
    return not flags & 0x1800 and place >= 0 and data[place + 28] < 8
