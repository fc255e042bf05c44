"""A page as SVG, its width and height given in millimetres, so that it prints and cuts at true size."""

from __future__ import annotations

from html import escape

from app.review.printing.page import Group, Item, Line, Page, Point, Polygon, Text


def svg_text(page: Page, title: str) -> str:
    """The file's content. SVG's y points down: heights are turned round here."""
    groups = "".join(_group(group, k, page.height) for k, group in enumerate(page.groups))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_n(page.width)}mm" height="{_n(page.height)}mm" '
        f'viewBox="0 0 {_n(page.width)} {_n(page.height)}">\n'
        f"<title>{escape(title)}</title>\n"
        f'<rect width="{_n(page.width)}" height="{_n(page.height)}" fill="#ffffff"/>\n'
        f"{groups}</svg>\n"
    )


def _group(group: Group, index: int, page_height: float) -> str:
    body = "".join(_item(item, page_height) for item in group.placed())
    if group.clip is None:
        return f"<g>\n{body}</g>\n"
    left, bottom, right, top = group.clip
    box = f'x="{_n(left)}" y="{_n(page_height - top)}" width="{_n(right - left)}" height="{_n(top - bottom)}"'
    return f'<clipPath id="c{index}"><rect {box}/></clipPath>\n<g clip-path="url(#c{index})">\n{body}</g>\n'


def _item(item: Item, page_height: float) -> str:
    def turned(point: Point) -> tuple[str, str]:
        return _n(point[0]), _n(page_height - point[1])

    match item:
        case Polygon(points, grey):
            corners = " ".join(",".join(turned(point)) for point in points)
            return f'<polygon points="{corners}" fill="{_grey(grey)}"/>\n'
        case Line(start, end, width, grey, dash):
            (x1, y1), (x2, y2) = turned(start), turned(end)
            dashes = f' stroke-dasharray="{_n(dash)}"' if dash > 0 else ""
            return (
                f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{_grey(grey)}" '
                f'stroke-width="{_n(width)}"{dashes}/>\n'
            )
        case Text(at, words, height, grey):
            x, y = turned(at)
            return (
                f'<text x="{x}" y="{y}" font-family="Helvetica, Arial, sans-serif" font-size="{_n(height)}" '
                f'text-anchor="middle" fill="{_grey(grey)}">{escape(words)}</text>\n'
            )


def _n(value: float) -> str:
    """A number with a tenth of a micrometre's precision, without trailing zeros."""
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _grey(grey: float) -> str:
    return "#" + f"{round(grey * 255):02x}" * 3
