"""What a person reads of a campaign on a terminal: the table, each failure, the command that replays it."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from app.campaign.figures import CampaignFigures, ScenarioFigures, Spread

HEADINGS = ("scenario", "landed", "95%", "error, cm", "speed, m/s", "time, s", "tries")
LEGEND = (
    "95%: Wilson's interval of the share that landed. Error of the vehicle's centre on the deck and speed relative to "
    "it at first contact, time from the order to land to the motors' stop: half / 95% / all of the trials lie below. "
    "Tries: mean / most."
)
WIDTH = 112
"""Of the table where no terminal says how wide it is."""


def spread_text(spread: Spread, scale: float = 1.0, digits: int = 1) -> str:
    """The three figures."""
    if spread.p50 is None or spread.p95 is None or spread.max is None:
        return "-"
    return " / ".join(f"{scale * value:.{digits}f}" for value in (spread.p50, spread.p95, spread.max))


def row_of(scenario: ScenarioFigures) -> tuple[str, ...]:
    """One scenario's cells, under HEADINGS."""
    low, high = scenario.interval95
    mean, most = scenario.tries
    return (
        scenario.name,
        f"{scenario.successes}/{len(scenario.results)}",
        f"{100 * low:.0f}..{100 * high:.0f}",
        spread_text(scenario.touchdown_error_m, 100.0),
        spread_text(scenario.touchdown_speed_m_s, 1.0, 2),
        spread_text(scenario.time_to_land_s),
        f"{mean:.1f} / {most}",
    )


def rate_text(figures: CampaignFigures) -> str:
    """How much was simulated, and how fast."""
    rate = figures.simulated_s / figures.wall_s if figures.wall_s > 0.0 else 0.0
    return f"{figures.simulated_s:.0f} s simulated in {figures.wall_s:.0f} s: {rate:.1f} simulated seconds a second"


def replay_text(argument: str, seed: int) -> str:
    """The command that flies one trial again."""
    return f"alight campaign --scenario {argument} --trials 1 --seed {seed}"


def print_campaign(figures: CampaignFigures, arguments: dict[str, str], console: Console) -> None:
    """Print it.

    Args:
        figures: What it came to.
        arguments: What names each scenario on the command line.
        console: Where.
    """
    if not console.is_terminal:
        console.width = max(console.width, WIDTH)
    table = Table(title="Alight: what the campaign came to", caption=LEGEND)
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading == "scenario" else "right", no_wrap=True)
    for scenario in figures.scenarios:
        table.add_row(*row_of(scenario))
    console.print(table)
    for scenario in figures.scenarios:
        for result in scenario.failures:
            console.print(f"{scenario.name} {result.seed}: {result.reason}", style="red", highlight=False)
            console.print(f"  {replay_text(arguments[scenario.name], result.seed)}", highlight=False, soft_wrap=True)
    console.print(rate_text(figures), highlight=False)
