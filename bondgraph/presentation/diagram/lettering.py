"""Text widths without a font.

The widths are those of DejaVu Sans and DejaVu Serif, in hundredths of the size: wide faces, so that text that fits with them also fits with
the narrower faces of a viewer. They come with matplotlib, which draws the PNG and PDF.
"""

from __future__ import annotations

_SANS = {
    27: "'", 28: "ijl", 29: "IJ", 32: " ,.", 34: "/:;\\|", 35: "f", 36: "-", 39: "()[]t", 40: "!", 41: "r", 46: '"', 50: "*_`", 52: "sz",
    53: "?", 55: "c", 56: "L", 58: "Fk", 59: "vxy", 60: "P", 61: "TYao", 62: "e", 63: "ESbdghnpqu", 64: "$0123456789{}", 66: "K", 68: "AV",
    69: "BRXZ", 70: "C", 73: "U", 75: "HN", 77: "DG", 78: "&", 79: "OQ", 82: "w", 84: "#+<=>^~", 86: "M", 95: "%", 97: "m", 99: "W", 100: "@",
}  # fmt: skip
_SERIF = {
    27: "'", 31: "j", 32: " ,.il", 34: "-/:;\\|", 37: "f", 39: "()[]", 40: "!IJt", 46: '"', 48: "r", 50: "*_`", 51: "s", 53: "z", 54: "?",
    56: "cvxy", 59: "e", 60: "ao", 61: "k", 64: "$0123456789bdghnpqu{}", 66: "LY", 67: "PT", 69: "FSZ", 71: "X", 72: "AV", 73: "BE", 75: "KR",
    77: "C", 80: "DG", 82: "OQ", 84: "#+<=>U^~", 86: "w", 87: "H", 88: "N", 89: "&", 95: "%m", 100: "@", 102: "M", 103: "W",
}  # fmt: skip
WIDTHS = {
    face: {c: w for w, characters in table.items() for c in characters}
    for face, table in (("sans", _SANS), ("serif", _SERIF))
}
WIDEST = 104  # for characters outside the tables: no letter of an alphabet is wider


def text_width(text: str, size: float, face: str = "sans") -> float:
    """Return the width of a line of text, in the unit of `size`."""
    return sum(WIDTHS[face].get(c, WIDEST) for c in text) * size / 100
