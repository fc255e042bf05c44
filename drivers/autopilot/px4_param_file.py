"""PX4's failsafe parameters: what deploy/px4 says they must be, and how a PX4's own differ. Pure.

A parameter file is QGroundControl's: rows of vehicle, component, name, value and type between tabs, and comments. The
comment right above a row is its reason. Only the section "# ---- Failsafes" is compared: the link's parameters are
right if they can be read, and handling is a matter of the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from app.config import SafetyConfig
from app.errors import ConfigError
from app.messages import ParameterFinding

SECTION = "# ---- "
FAILSAFES = "Failsafes"
CRITICAL = frozenset({"COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_RC_OVERRIDE"})
"""Without these nobody is safe: the vehicle flies on without Alight, falls, or does not obey the pilot's sticks."""
RELATIVE_TOLERANCE = 1e-5
"""A REAL32 has 24 bits: 0.12 comes back as 0.11999999731779099."""


@dataclass(frozen=True, slots=True)
class WantedParameter:
    """A parameter as deploy/px4 wants it.

    Attributes:
        name: PX4's.
        value: As the main file has it.
        others: Values that other files, which are loaded on top of the main one, give it.
        reason: One or more sentences.
    """

    name: str
    value: float
    others: tuple[float, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A row of a parameter file.

    Attributes:
        section: What the last section line says; "" before the first.
        name: PX4's.
        value: As written.
        kind: MAV_PARAM_TYPE: 6 INT32, 9 REAL32.
        reason: The comment right above the row, or above the rows that it follows without a break.
    """

    section: str
    name: str
    value: float
    kind: int
    reason: str


def parse_rows(text: str, path: Path) -> Iterator[ParameterRow]:
    """The rows of a parameter file.

    Raises:
        ConfigError: A line is neither a comment nor a row.
    """
    section, reason, after_row = "", "", True
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith(SECTION):
            section, reason = line.removeprefix(SECTION).strip(), ""
        elif line.startswith("#"):
            words = line.lstrip("# ").strip()
            reason = f"{reason} {words}" if words and reason and not after_row else words
            after_row = False
        elif line.strip():
            try:
                _, _, name, value, kind = line.split("\t")
                row = ParameterRow(section, name, float(value), int(kind), reason)
            except ValueError:
                raise ConfigError(
                    f"{path}: line {number} is no parameter: {line!r}",
                    "write vehicle, component, name, value and type with tabs between them",
                ) from None
            yield row
            after_row = True


def read_wanted(main: Path, *on_top: Path) -> tuple[WantedParameter, ...]:
    """The failsafe parameters of a main file; a value that a file on top of it gives one is as good.

    Raises:
        ConfigError: A file is missing or wrong.
    """
    others = [row for path in on_top for row in parse_rows(_read(path), path)]
    wanted = tuple(
        WantedParameter(row.name, row.value, tuple(o.value for o in others if o.name == row.name), row.reason)
        for row in parse_rows(_read(main), main)
        if row.section == FAILSAFES
    )
    if not wanted:
        raise ConfigError(f"{main}: no section {SECTION}{FAILSAFES}", "restore the file that came with Alight")
    return wanted


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: can't be read ({error})", "restore the file that came with Alight") from None


@dataclass(frozen=True, slots=True)
class ParameterCheck:
    """What PX4's parameters are compared with.

    Attributes:
        source: What the findings call the file, as in "deploy/px4/alight.params".
        wanted: Its failsafe parameters.
        safety: Alight's own limits, which have to act before PX4's.
        must_match: A difference of a critical parameter prevents arming.
    """

    source: str
    wanted: tuple[WantedParameter, ...]
    safety: SafetyConfig
    must_match: bool

    def findings(self, read: Mapping[str, float]) -> tuple[ParameterFinding, ...]:
        """How PX4's parameters differ, the critical ones first.

        Args:
            read: PX4's values by name; NaN for a value that can't be read, none for a parameter without an answer.
        """
        if not read:
            words = "PX4 does not tell its parameters (PARAM_REQUEST_READ): its failsafes are unknown"
            return (ParameterFinding("", words, "PX4 does not tell its failsafe parameters", critical=True),)
        differing = [self._difference(one, read.get(one.name)) for one in self.wanted if not _matches(one, read)]
        differing.sort(key=lambda finding: not finding.critical)
        return (*differing, *self._conflicts(read))

    def _difference(self, wanted: WantedParameter, value: float | None) -> ParameterFinding:
        name = wanted.name
        critical = name in CRITICAL
        if value is None:
            says = f"{name}: PX4 gave no answer"
            brief = f"{name}: no answer from PX4"
        elif math.isnan(value):
            says = brief = f"{name} is negative"
        else:
            says = brief = f"{name} is {_number(value)}"
        if value is not None:
            brief += f", must be {_number(wanted.value)}"
        return ParameterFinding(
            name, f"{says}, {self.source} says {_number(wanted.value)}: {wanted.reason}", brief, critical
        )

    def _conflicts(self, read: Mapping[str, float]) -> Iterator[ParameterFinding]:
        """Limits of PX4 that would act before Alight's own. 0 switches a side of PX4's fence off."""
        safety = self.safety
        limits = (
            ("GF_MAX_HOR_DIST", "distance_from_home_max_m", safety.distance_from_home_max_m, "beyond"),
            ("GF_MAX_VER_DIST", "height_max_m", safety.height_max_m, "beyond"),
            ("RTL_RETURN_ALT", "height_max_m", safety.height_max_m, "below"),
            ("BAT_CRIT_THR", "battery_min_fraction", safety.battery_min_fraction, "below"),
        )
        for name, key, limit, side in limits:
            value = read.get(name, 0.0)
            if value > 0.0 and (value <= limit if side == "beyond" else value >= limit):
                is_value = f"{name} is {_number(value)}"
                words = f"{is_value}, but has to be {side} safety.{key} of the rig, which is {_number(limit)}"
                yield ParameterFinding(name, words, f"{is_value}, rig has {_number(limit)}", critical=False)


def _matches(wanted: WantedParameter, read: Mapping[str, float]) -> bool:
    value = read.get(wanted.name)
    return value is not None and any(
        math.isclose(value, good, rel_tol=RELATIVE_TOLERANCE) for good in (wanted.value, *wanted.others)
    )


def _number(value: float) -> str:
    """0.11999999731779099 as 0.12, 121212.0 as 121212."""
    return f"{value:.7g}"
