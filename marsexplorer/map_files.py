"""Map files of robots: the YAML and the picture of ROS's map_server and Nav2.

Where the two differ, this is Nav2's reading. The picture becomes a grey of 0..255 a pixel, and its
darkness p = 1 - grey / 255 (grey / 255 where `negate` is set) decides by `mode`:

    trinary  free (0) for p <= free_thresh, else occupied (100) for p >= occupied_thresh, else
             unknown (-1)
    scale    the same, but between the thresholds p becomes 0..100
    raw      the grey itself is the occupancy up to 100, unknown above

In `trinary` and `scale` a pixel that is not opaque is unknown.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL.Image import Image
    from yaml import Node

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Occupancies of a pixel, as `nav_msgs/OccupancyGrid` has them."""
MODES = ("trinary", "scale", "raw")
PICTURES = ("PPM", "PNG", "BMP", "JPEG", "GIF", "TIFF", "TGA", "PCX", "WEBP")
"""Kinds of pictures that are read, by Pillow's names; PPM is also PGM and PBM."""
MAX_PIXELS = 64_000_000
"""Pictures with more pixels are refused."""
MAX_YAML_BYTES = 100_000
UNKNOWN_GREY = 205
"""What map savers write for a pixel that nobody has seen."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|\d+)")
_TRUE, _FALSE = ("y", "yes", "true", "on"), ("n", "no", "false", "off")


class MapFileError(ValueError):
    """A map cannot be read: what was expected, what came, what to do."""


class MapWarning(UserWarning):
    """A map is read, but may not be what its owner thinks."""


@dataclass(frozen=True)
class Occupancy:
    """What a map file says of each pixel.

    cells       int8[height, width], 0 free to 100 occupied, -1 unknown; row 0 at the north edge
    resolution  metres of a pixel's side
    origin      (x, y, yaw) of the picture's south-west corner: metres, and radians
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]


@dataclass(frozen=True)
class _Fields:
    """The fields of a YAML file, checked."""

    picture: Path
    resolution: float
    origin: tuple[float, float, float]
    mode: str
    negate: bool
    free: float
    occupied: float


def read_occupancy(path: Path) -> Occupancy:
    """Read a map_server YAML file and its picture; MapFileError if either is unusable."""
    fields = _read_fields(path)
    grey, is_clear = _read_picture(fields.picture)
    meanings = _occupancies(fields)
    cells = meanings[grey]
    if is_clear is not None and fields.mode != "raw":
        cells[is_clear] = UNKNOWN
    _warn(path, fields, meanings, grey)
    return Occupancy(cells, fields.resolution, fields.origin)


def _occupancies(fields: _Fields) -> NDArray[np.int8]:
    """The occupancy of each grey: int8[256]."""
    greys = np.arange(256)
    if fields.mode == "raw":
        return np.where(greys <= OCCUPIED, greys, UNKNOWN).astype(np.int8)
    shares = greys.astype(np.float32) / np.float32(255)
    darkness = shares if fields.negate else np.float32(1) - shares
    free, occupied = np.float32(fields.free), np.float32(fields.occupied)
    meanings = np.full(256, UNKNOWN, np.int8)
    if fields.mode == "scale":
        between = (darkness > free) & (darkness < occupied)
        scaled = (darkness[between] - free) / np.float32(fields.occupied - fields.free)
        meanings[between] = np.floor(scaled * np.float32(100) + np.float32(0.5)).astype(np.int8)
    meanings[darkness >= occupied] = OCCUPIED
    meanings[darkness <= free] = FREE
    return meanings


def _warn(path: Path, fields: _Fields, meanings: NDArray[np.int8], grey: NDArray[np.uint8]) -> None:
    """Warn of a map that reads as something else than it looks like."""
    if fields.mode == "scale" and fields.free <= 0.01 and fields.occupied >= 0.99:
        _say(
            f"{path} looks like a mask of speeds, not a map of rooms: mode scale from "
            f"{fields.free:g} to {fields.occupied:g}. It is read as Nav2 reads it; the map beside "
            "it is probably meant"
        )
    elif fields.mode != "raw" and meanings[UNKNOWN_GREY] == FREE and (grey == UNKNOWN_GREY).any():
        share = np.mean(grey == UNKNOWN_GREY)
        remedy = "free_thresh: 0.196" + (" and mode: trinary" if fields.mode == "scale" else "")
        _say(
            f"{path}: free_thresh {fields.free:g} makes the {share:.0%} of the pixels free that "
            f"have grey {UNKNOWN_GREY}, which map savers write for unknown; write {remedy} if "
            "they are unknown"
        )


def _say(message: str) -> None:
    warnings.warn(message, MapWarning, stacklevel=5)


def _read_fields(path: Path) -> _Fields:
    """Read and check the fields of a YAML file."""
    fields = _Reader(path, _read_nodes(path))
    name = fields.text("image", "the picture's file, as in image: map.pgm")
    if not name:
        raise fields.error("image", "the picture's file, as in image: map.pgm", "an empty name")
    resolution = fields.number("resolution")
    if not resolution > 0:
        raise fields.error(
            "resolution", "metres above 0, as in resolution: 0.05", f"{resolution:g}"
        )
    mode = (
        fields.text("mode", f"one of {', '.join(MODES)}").lower() if "mode" in fields else MODES[0]
    )
    if mode not in MODES:
        raise fields.error("mode", f"one of {', '.join(MODES)}", repr(mode))
    return _Fields(
        path.parent / name,
        resolution,
        fields.origin(),
        mode,
        fields.flag("negate"),
        fields.number("free_thresh"),
        fields.number("occupied_thresh"),
    )


def _read_nodes(path: Path) -> Mapping[str, Node]:
    """The nodes of a YAML file's first document by name; of repeated names, the first."""
    import yaml

    try:
        content = path.read_bytes()
        if len(content) > MAX_YAML_BYTES:
            raise MapFileError(
                f"{path}: expected at most {MAX_YAML_BYTES:,} bytes of YAML, got {len(content):,}; "
                "name the YAML file, not the picture"
            )
        document = next(yaml.compose_all(content, yaml.SafeLoader), None)
    except OSError as error:
        raise MapFileError(
            f"{path} is no readable YAML file: {error.strerror}; check the path"
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MapFileError(f"{path} is no readable YAML file: {error}") from error
    if not isinstance(document, yaml.MappingNode):
        raise MapFileError(
            f"{path}: expected the fields of a map_server file, such as image and resolution, "
            "got none"
        )
    return {str(key.value): node for key, node in reversed(document.value)}


class _Reader:
    """The nodes of a YAML file as values of a type, as yaml-cpp reads them."""

    def __init__(self, path: Path, nodes: Mapping[str, Node]) -> None:
        self._path, self._nodes = path, nodes

    def __contains__(self, name: str) -> bool:
        return name in self._nodes

    def error(self, name: str, expected: str, came: str) -> MapFileError:
        """An error about a field, with its line."""
        node = self._nodes.get(name)
        line = "" if node is None else f", line {node.start_mark.line + 1}"
        return MapFileError(f"{self._path}{line}: {name}: expected {expected}, got {came}")

    def text(self, name: str, expected: str) -> str:
        """The text of a field."""
        return self._scalar(name, self._nodes.get(name), expected)

    def number(self, name: str) -> float:
        """The number of a field, written in any way that C++ reads."""
        return self._number(name, self._nodes.get(name))

    def flag(self, name: str) -> bool:
        """A field that is a whole number or a word for true or false."""
        expected = f"0 or 1, true or false, as in {name}: 0"
        written = self.text(name, expected)
        if _WHOLE.fullmatch(written):
            return written.strip("+-0xX") != ""
        if (word := written.lower()) in _TRUE + _FALSE:
            return word in _TRUE
        raise self.error(name, expected, repr(written))

    def origin(self) -> tuple[float, float, float]:
        """The field `origin`."""
        import yaml

        expected = "x, y and yaw, as in origin: [-10.0, -10.0, 0.0]"
        node = self._nodes.get("origin")
        if not isinstance(node, yaml.SequenceNode):
            raise self.error("origin", expected, "none" if node is None else repr(node.value))
        if len(node.value) != 3:
            raise self.error("origin", expected, f"{len(node.value)} values")
        x, y, yaw = (self._number("origin", value) for value in node.value)
        return x, y, yaw

    def _number(self, name: str, node: Node | None) -> float:
        expected = "a number, as in 0.05 or 5e-2"
        written = self._scalar(name, node, expected)
        number = float(written) if _NUMBER.fullmatch(written) else math.nan
        if not abs(number) <= 1e9:
            raise self.error(name, expected, repr(written))
        return number

    def _scalar(self, name: str, node: Node | None, expected: str) -> str:
        import yaml

        if node is None:
            raise self.error(name, expected, "no such line; add it")
        if not isinstance(node, yaml.ScalarNode) or node.tag.endswith(":null"):
            raise self.error(name, expected, "nothing" if node.tag.endswith(":null") else "a list")
        return str(node.value)


def _read_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """The grey of each pixel, uint8[height, width], and which pixels are not opaque.

    The second is None for a picture without alpha.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # MAX_PIXELS is checked
            with Image.open(path, formats=PICTURES) as picture:
                if picture.width * picture.height > MAX_PIXELS:
                    raise _too_large(path, f"{picture.width} x {picture.height}")
                return _grey_of(path, picture)
    except UnidentifiedImageError as error:
        raise MapFileError(
            f"{path} is no picture that is read; save it as PGM or PNG (also read: BMP, GIF, "
            "JPEG, PBM, PCX, PPM, TGA, TIFF, WebP)"
        ) from error
    except OSError as error:
        raise MapFileError(
            f"{path} is no readable picture: {error.strerror or error}; check the field image "
            "of the YAML file"
        ) from error
    except Image.DecompressionBombError as error:  # its picture is not returned
        raise _too_large(path, "more than twice as many") from error
    except (ValueError, SyntaxError) as error:
        if isinstance(error, MapFileError):
            raise
        raise MapFileError(f"{path} is no readable picture: {error}; save it again") from error


def _too_large(path: Path, came: str) -> MapFileError:
    """The error for a picture of more than MAX_PIXELS."""
    return MapFileError(
        f"{path}: at most {MAX_PIXELS:,} pixels are read, got {came}; "
        "cut the map to what is known, or save it at a larger resolution"
    )


def _grey_of(path: Path, picture: Image) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    if picture.mode == "I" or picture.mode.startswith("I;16"):  # 16 bits a pixel
        deep = np.asarray(picture)
        if picture.format not in ("PPM", "PNG") and not picture.mode.startswith("I;16"):
            raise MapFileError(f"{path}: expected 8 or 16 bits a colour, got 32; save it with 8")
        return (deep // 257).astype(np.uint8), None
    if picture.mode == "F":
        raise MapFileError(f"{path}: expected 8 or 16 bits a colour, got fractions; save it with 8")
    is_clear = None
    if "transparency" in picture.info or picture.mode in ("RGBA", "LA", "PA", "La", "RGBa"):
        picture = picture.convert("RGBA")
        is_clear = np.asarray(picture.getchannel("A")) < 255
    if picture.mode in ("L", "1"):
        return np.asarray(picture.convert("L")), is_clear
    colours = np.asarray(picture.convert("RGB"), np.uint32)
    grey = colours @ np.array([306, 601, 117], np.uint32) // 1024
    return grey.astype(np.uint8), is_clear
