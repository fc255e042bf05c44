"""PX4's failsafe parameters: what the files in deploy/px4 say, and how differences are told."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from app.config import RigConfig, SafetyConfig
from app.errors import ConfigError
from app.wiring import CONFIGS, PARAMETERS, PARAMETERS_ON_TOP, load_rig, parameter_check
from drivers.autopilot.px4_param_file import CRITICAL, ParameterCheck, WantedParameter, parse_rows, read_wanted
from drivers.autopilot.px4_params import parameter_value
from drivers.simulator.params import DEFAULTS, NO_EFFECT

PROJECT = CONFIGS.parent
SHIPPED = read_wanted(PROJECT / PARAMETERS, *(PROJECT / name for name in PARAMETERS_ON_TOP))
AS_SHIPPED = {one.name: one.value for one in SHIPPED}
FILE = Path("some.params")


def single(value: float) -> float:
    """As it comes back in a REAL32."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def check_of(wanted: tuple[WantedParameter, ...] = SHIPPED, **safety: float) -> ParameterCheck:
    return ParameterCheck(PARAMETERS, wanted, SafetyConfig(**safety), must_match=True)


# -------------------------------------------------------------------------------------------------------- the file
def test_parameter_rows_take_the_comment_right_above_them_as_their_reason() -> None:
    text = (
        "# of the file\n# ---- Link\n1\t1\tA\t2\t6\n#\n# ---- Failsafes\n# of the section\n#\n# first,\n# and on\n"
        "1\t1\tB\t0.5\t9\n1\t1\tC\t1\t6\n# last\n1\t1\tD\t-1\t6\n"
    )
    rows = [(row.section, row.name, row.value, row.reason) for row in parse_rows(text, FILE)]
    assert rows == [
        ("Link", "A", 2.0, ""),
        ("Failsafes", "B", 0.5, "first, and on"),
        ("Failsafes", "C", 1.0, "first, and on"),
        ("Failsafes", "D", -1.0, "last"),
    ]


@pytest.mark.parametrize("line", ["1 1 A 2 6", "1\t1\tA\tx\t6", "1\t1\tA"])
def test_parameter_file_with_a_broken_line_names_it(line: str) -> None:
    with pytest.raises(ConfigError, match=r"some\.params: line 2 is no parameter"):
        list(parse_rows(f"# ---- Failsafes\n{line}\n", FILE))


@pytest.mark.parametrize(
    ("text", "words"), [(None, "can't be read"), ("1\t1\tA\t1\t6\n", "no section # ---- Failsafes")]
)
def test_parameter_file_without_failsafes_is_an_error(tmp_path: Path, text: str | None, words: str) -> None:
    path = tmp_path / "alight.params"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_wanted(path)


# --------------------------------------------------------------------------------------------- what Alight ships
def test_each_failsafe_that_ships_has_a_reason() -> None:
    assert [one.name for one in SHIPPED if len(one.reason.split()) < 4] == []
    assert AS_SHIPPED.keys() >= CRITICAL


@pytest.mark.parametrize(
    ("name", "value"),
    # Meanings as in PX4's source (commander, navigator and battery parameters of v1.16).
    [
        ("COM_OBL_RC_ACT", 5),  # Hold
        ("COM_RC_OVERRIDE", 3),  # automatic modes (bit 0) and offboard (bit 1)
        ("COM_LOW_BAT_ACT", 3),  # Return at the critical level, Land at the emergency level
        ("NAV_RCL_ACT", 2),  # Return
        ("NAV_DLL_ACT", 0),  # none
        ("GF_ACTION", 3),  # Return
        ("COM_POSCTL_NAVL", 0),  # Altitude mode
        ("RTL_TYPE", 0),  # home or rally point, straight
        ("CBRK_FLIGHTTERM", 121212),  # flight termination is off
    ],
)
def test_failsafes_that_ship_have_these_meanings_in_px4(name: str, value: int) -> None:
    assert AS_SHIPPED[name] == value


def test_px4_acts_outside_of_alights_own_limits_and_returns_inside_of_them() -> None:
    safety = SafetyConfig()
    assert AS_SHIPPED["GF_MAX_HOR_DIST"] > safety.distance_from_home_max_m
    assert AS_SHIPPED["GF_MAX_VER_DIST"] > safety.height_max_m
    assert AS_SHIPPED["RTL_DESCEND_ALT"] <= AS_SHIPPED["RTL_RETURN_ALT"] < safety.height_max_m
    levels = [AS_SHIPPED[f"BAT_{level}_THR"] for level in ("EMERGEN", "CRIT", "LOW")]
    assert levels == sorted(levels)
    assert AS_SHIPPED["BAT_CRIT_THR"] < safety.battery_min_fraction < AS_SHIPPED["BAT_LOW_THR"]


def test_simulated_px4_knows_every_failsafe_that_is_read_back_with_its_type() -> None:
    known = DEFAULTS | NO_EFFECT
    kinds = {
        row.name: row.kind for row in parse_rows((PROJECT / PARAMETERS).read_text(), FILE) if row.name in AS_SHIPPED
    }
    assert {name: 6 if isinstance(known[name], int) else 9 for name in kinds} == kinds


@pytest.mark.parametrize(
    ("rig", "must_match"), [("raspberry-pi.toml", True), ("sitl.toml", False), ("simulator.toml", False)]
)
def test_rig_that_ships_checks_px4s_parameters(rig: str, must_match: bool) -> None:
    check = parameter_check(load_rig(CONFIGS / rig))
    assert check is not None
    assert check.must_match is must_match


def test_rig_that_switches_the_check_off_reads_no_parameters() -> None:
    rig = load_rig(CONFIGS / "sitl.toml")
    autopilot = rig.config.autopilot.model_copy(update={"check_parameters": "off"})
    off = RigConfig.model_copy(rig.config, update={"autopilot": autopilot})
    assert parameter_check(type(rig)(rig.path, off, rig.landmark, rig.lens_config, rig.lens)) is None


# -------------------------------------------------------------------------------------------------------- findings
def test_px4_with_the_shipped_values_has_no_findings() -> None:
    assert check_of().findings({name: single(value) for name, value in AS_SHIPPED.items()}) == ()


def test_px4_with_a_value_of_a_file_on_top_has_no_findings() -> None:
    assert check_of().findings(AS_SHIPPED | {"COM_DISARM_LAND": single(0.1)}) == ()


def test_difference_is_told_with_both_values_and_the_reason() -> None:
    (finding,) = check_of().findings(AS_SHIPPED | {"COM_LOW_BAT_ACT": 0.0})
    reason = next(one.reason for one in SHIPPED if one.name == "COM_LOW_BAT_ACT")
    assert finding.words == f"COM_LOW_BAT_ACT is 0, deploy/px4/alight.params says 3: {reason}"
    assert finding.brief == "COM_LOW_BAT_ACT is 0, must be 3"
    assert not finding.critical


@pytest.mark.parametrize(
    ("value", "words"),
    [(None, "COM_RCL_EXCEPT: PX4 gave no answer, "), (math.nan, "COM_RCL_EXCEPT is negative, ")],
)
def test_parameter_that_cannot_be_read_is_told(value: float | None, words: str) -> None:
    read = {name: v for name, v in AS_SHIPPED.items() if name != "COM_RCL_EXCEPT"}
    (finding,) = check_of().findings(read if value is None else read | {"COM_RCL_EXCEPT": value})
    assert finding.words.startswith(words)


def test_px4_that_tells_no_parameter_is_one_critical_finding() -> None:
    (finding,) = check_of().findings({})
    assert finding.critical
    assert finding.words == "PX4 does not tell its parameters (PARAM_REQUEST_READ): its failsafes are unknown"


@pytest.mark.parametrize("name", sorted(CRITICAL))
def test_difference_without_which_nobody_is_safe_is_critical_and_comes_first(name: str) -> None:
    first, second = check_of().findings(AS_SHIPPED | {name: 7.0, "BAT_CRIT_THR": 0.01})
    assert (first.name, first.critical, second.name, second.critical) == (name, True, "BAT_CRIT_THR", False)


@pytest.mark.parametrize(
    ("key", "limit", "what", "side"),
    [
        ("distance_from_home_max_m", 400.0, "GF_MAX_HOR_DIST is 350", "beyond"),
        ("height_max_m", 40.0, "GF_MAX_VER_DIST is 40", "beyond"),
        ("height_max_m", 20.0, "RTL_RETURN_ALT is 20", "below"),
        ("battery_min_fraction", 0.1, "BAT_CRIT_THR is 0.12", "below"),
    ],
)
def test_limit_of_px4_that_acts_before_the_rigs_is_told(key: str, limit: float, what: str, side: str) -> None:
    (finding,) = check_of(**{key: limit}).findings(AS_SHIPPED)
    assert finding.words == f"{what}, but has to be {side} safety.{key} of the rig, which is {limit:g}"


@pytest.mark.parametrize("value", [0.0, 1e9, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", sorted(AS_SHIPPED))
def test_brief_finding_fits_a_phones_line(name: str, value: float) -> None:
    briefs = [finding.brief for finding in check_of().findings(AS_SHIPPED | {name: value})]
    assert [brief for brief in briefs if len(brief) > 50] == []


# ------------------------------------------------------------------------------------------------------ PARAM_VALUE
@pytest.mark.parametrize("value", [0, 1, 5, 121212, 2_000_000_000])
def test_int32_parameter_is_read_from_the_bytes_of_the_float(value: int) -> None:
    on_the_wire = struct.unpack("<f", struct.pack("<i", value))[0]
    assert parameter_value({"param_value": on_the_wire, "param_type": 6}) == value


def test_real32_parameter_is_read_as_it_is() -> None:
    assert parameter_value({"param_value": 0.5, "param_type": 9}) == 0.5


def test_int32_parameter_whose_bytes_are_not_a_number_is_unknown() -> None:
    assert math.isnan(struct.unpack("<f", struct.pack("<i", -1))[0])
    assert math.isnan(parameter_value({"param_value": None, "param_type": 6}))
