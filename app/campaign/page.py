"""A campaign as one self-contained HTML page: the table, where the touchdowns were, the failures. No links outside."""

from __future__ import annotations

from html import escape

from app.campaign.figures import CampaignFigures, ScenarioFigures
from app.campaign.tables import HEADINGS, LEGEND, rate_text, replay_text, row_of

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em; color: #1b1b1b; }
table { border-collapse: collapse; width: 100%; } td, th { padding: .35em .7em; text-align: right; }
td:first-child, th:first-child { text-align: left; } tbody tr:nth-child(odd) { background: #f3f4f6; }
th { border-bottom: 2px solid #888; } figure { display: inline-block; margin: 1em 1em 0 0; }
figcaption { text-align: center; } .bad { color: #b3261e; } code { background: #f3f4f6; padding: .1em .3em; }
"""
SIZE_PX = 300
PAD_HALF_M = 0.19
"""Half the side of the paper's landmark, drawn as a measure."""
ROUND_M = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Rings are drawn at these distances; the outermost that is needed fills the picture."""


def page_of(figures: CampaignFigures, arguments: dict[str, str], title: str) -> str:
    """The page.

    Args:
        figures: What the campaign came to.
        arguments: What names each scenario on the command line.
        title: Of the page: the command.
    """
    head = "".join(f"<th>{escape(heading)}</th>" for heading in HEADINGS)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row_of(scenario)) + "</tr>"
        for scenario in figures.scenarios
    )
    plots = "".join(_scatter(scenario) for scenario in figures.scenarios)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body><h1>Alight: what the campaign came to</h1>"
        f"<p><code>{escape(title)}</code></p><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"<p>{escape(LEGEND)}</p><p>{escape(rate_text(figures))}</p><h2>Touchdowns, in the pad's frame</h2>{plots}"
        f"<h2>Failures</h2>{_failures(figures, arguments)}</body></html>\n"
    )


def _scatter(scenario: ScenarioFigures) -> str:
    """Where the vehicle's centre was at first contact: up is the pad's forward, right its right."""
    places = [
        (result.touchdown_right_m, result.touchdown_forward_m, result.landed)
        for result in scenario.results
        if result.touchdown_right_m is not None and result.touchdown_forward_m is not None
    ]
    farthest = max((max(abs(right), abs(forward)) for right, forward, _ in places), default=0.0)
    reach = next((r for r in ROUND_M if r >= 1.02 * farthest), ROUND_M[-1])
    scale, middle = 0.46 * SIZE_PX / reach, SIZE_PX / 2.0
    parts = [f'<rect width="{SIZE_PX}" height="{SIZE_PX}" fill="#fafafa"/>']
    half = PAD_HALF_M * scale
    parts.append(
        f'<rect x="{middle - half:.1f}" y="{middle - half:.1f}" width="{2 * half:.1f}" height="{2 * half:.1f}" '
        'fill="none" stroke="#999" stroke-dasharray="4 3"/>'
    )
    for ring in ROUND_M:
        if reach / 5.0 < ring <= reach:
            parts.append(f'<circle cx="{middle}" cy="{middle}" r="{ring * scale:.1f}" fill="none" stroke="#ddd"/>')
            parts.append(
                f'<text x="{middle}" y="{middle - ring * scale + 11:.1f}" font-size="10" fill="#888" '
                f'text-anchor="middle">{100 * ring:.0f} cm</text>'
            )
    for right, forward, landed in places:
        colour = "#1a66c2" if landed else "#b3261e"
        parts.append(
            f'<circle cx="{middle + right * scale:.1f}" cy="{middle - forward * scale:.1f}" r="3" '
            f'fill="{colour}" fill-opacity="0.7"/>'
        )
    box = f'viewBox="0 0 {SIZE_PX} {SIZE_PX}" width="{SIZE_PX}" height="{SIZE_PX}"'
    caption = f"<figcaption>{escape(scenario.name)}: {len(places)} touchdowns</figcaption>"
    return f'<figure><svg {box} role="img">{"".join(parts)}</svg>{caption}</figure>'


def _failures(figures: CampaignFigures, arguments: dict[str, str]) -> str:
    items = [
        f'<li><span class="bad">{escape(scenario.name)} {result.seed}: {escape(result.reason or "")}</span><br>'
        f"<code>{escape(replay_text(arguments[scenario.name], result.seed))}</code></li>"
        for scenario in figures.scenarios
        for result in scenario.failures
    ]
    return f"<ul>{''.join(items)}</ul>" if items else "<p>None.</p>"
