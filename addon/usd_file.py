"""Whether a USD file was written to its end: Blender's exporter does not say when the disk was full. No bpy here."""

import struct
from pathlib import Path

CRATE = b"PXR-USDC"  # begins the binary form; 8 bytes of version follow, and where its table of contents is
SECTION = struct.Struct("<16sqq")  # name, where it begins, its bytes
MOST_SECTIONS = 64


def is_whole(path: Path) -> bool:
    """True for a binary file whose table of contents, which is written last, and all that it names lie within it, and
    for a text whose last brace is there.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(24)
        if head[:8] != CRATE:
            return head.startswith(b"#usda") and path.read_bytes().rstrip().endswith(b"}")
        if len(head) < 24:
            return False
        (contents,) = struct.unpack("<q", head[16:])
        if not 24 < contents <= size - 8:
            return False
        file.seek(contents)
        (count,) = struct.unpack("<Q", file.read(8))
        if not 0 < count <= MOST_SECTIONS or contents + 8 + count * SECTION.size > size:
            return False
        sections = [SECTION.unpack(file.read(SECTION.size)) for _ in range(count)]
    return all(begin >= 24 and length >= 0 and begin + length <= size for _, begin, length in sections)
