"""Figure as SVG text: no script, no link, equal bytes for equal figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.sax.saxutils import escape, quoteattr

from ..text.tables import visible
from .figure import Circle, Figure, Group, Lettering, Polyline, RoundedBox, Shape
from .styles import DARK, MARKS, SHAPE_STYLES, STYLES, Style

FACES = {
    "serif": "'STIX Two Text','Times New Roman',Times,'Liberation Serif','DejaVu Serif',serif",
    "sans": "'Helvetica Neue',Helvetica,Arial,'Liberation Sans','DejaVu Sans',sans-serif",
}


def svg_text(figure: Figure, rules: bool = True) -> str:
    """Return the text of an SVG file; without `rules` for a page that has them in its own style."""
    return "\n".join(_lines(figure, rules)) + "\n"


def style_rules(shapes: Mapping[str, Style] = SHAPE_STYLES) -> str:
    """Return the styles, with these of shapes of bodies, as CSS rules, in light and dark; they apply inside the picture only."""
    styles = {**STYLES, **shapes}
    return f"{''.join(_rules(styles))}@media (prefers-color-scheme:dark){{{''.join(_dark_rules(styles))}}}"


def _lines(figure: Figure, rules: bool) -> Iterator[str]:
    size = (
        f'width="{_n(figure.width)}" height="{_n(figure.height)}" viewBox="0 0 {_n(figure.width)} {_n(figure.height)}"'
    )
    yield f'<svg xmlns="http://www.w3.org/2000/svg" class="bondgraph" {size} role="img">'
    yield f"<title>{_words(figure.title)}</title>"
    if rules:
        looks = {shape.look for group in figure.groups for shape in group.shapes}
        yield f"<style>{style_rules({name: SHAPE_STYLES[name] for name in SHAPE_STYLES if name in looks})}</style>"
    yield f'<rect class="ground" width="{_n(figure.width)}" height="{_n(figure.height)}"/>'
    for group in figure.groups:
        yield from _group(group)
    yield "</svg>"


def _rules(styles: Mapping[str, Style]) -> Iterator[str]:
    for name, look in styles.items():
        yield f".bondgraph .{name}{{{_rule(look)}}}"
    yield from _marked(MARKS)


def _dark_rules(styles: Mapping[str, Style]) -> Iterator[str]:
    """Yield the rules of the colours alone."""
    for name, look in styles.items():
        fill = "none" if not look.filled and not look.size else DARK[look.inside or look.colour]
        stroke = f"stroke:{DARK[look.colour]}" * (not look.size and look.width > 0)
        yield f".bondgraph .{name}{{fill:{fill};{stroke}}}"
    yield from _marked({mark: DARK[colour] for mark, colour in MARKS.items()})


def _marked(marks: Mapping[str, str]) -> Iterator[str]:
    for mark, colour in marks.items():
        texts = ",".join(f".bondgraph .{mark} .{n}" for n, k in STYLES.items() if k.marked and k.size)
        strokes = ",".join(f".bondgraph .{mark} .{n}" for n, k in STYLES.items() if k.marked and not k.size)
        yield f"{texts}{{fill:{colour}}}{strokes}{{stroke:{colour}}}"


def _rule(look: Style) -> str:
    if look.size:
        style = "font-style:italic;" * look.italic + "font-weight:600;" * look.bold
        return f"fill:{look.colour};stroke:none;font-family:{FACES[look.face]};font-size:{_n(look.size)}px;{style}"
    dashes = f"stroke-dasharray:{' '.join(map(_n, look.dashes))};" if look.dashes else ""
    fill = look.inside or look.colour if look.filled else "none"
    if not look.width:
        return f"fill:{fill}"
    return f"fill:{fill};stroke:{look.colour};stroke-width:{_n(look.width)};stroke-linecap:round;stroke-linejoin:round;{dashes}"


def _group(group: Group) -> Iterator[str]:
    facts = "".join(f" data-{name}={quoteattr(_plain(value))}" for name, value in group.facts.items())
    yield f'<g class="{group.kind}{" " * bool(group.mark)}{group.mark}"{facts}>'
    if group.words:
        yield f"<title>{_words(group.words)}</title>"
    for shape in group.shapes:
        yield _shape(shape)
    yield "</g>"


def _shape(shape: Shape) -> str:
    match shape:
        case Polyline(points, look, closed):
            way = "L".join(f"{_n(x)} {_n(y)}" for x, y in points)
            return f'<path class="{look}" d="M{way}{"Z" * closed}"/>'
        case Circle((x, y), radius, look):
            return f'<circle class="{look}" cx="{_n(x)}" cy="{_n(y)}" r="{_n(radius)}"/>'
        case RoundedBox(left, top, width, height, look, rounding):
            place = f'x="{_n(left)}" y="{_n(top)}" width="{_n(width)}" height="{_n(height)}"'
            return f'<rect class="{look}" {place} rx="{_n(rounding)}"/>'
        case Lettering(text, x, y, look, anchor):
            side = f' text-anchor="{anchor}"' if anchor != "start" else ""
            return f'<text class="{look}" x="{_n(x)}" y="{_n(y)}"{side}>{_words(text)}</text>'


def _n(value: float) -> str:
    """Return a number with at most two decimals."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _plain(text: str) -> str:
    """Return text without characters that would change the reading direction or break a file."""
    return visible(text)


def _words(text: str) -> str:
    return escape(_plain(text))
