"""The phone's buttons order what the link understands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from app.messages import OperatorAction
from drivers.operator.conversations import Conversations

FILE = Path(__file__).parents[3] / "configs" / "qgroundcontrol" / "Alight.json"
ACTIONS: list[dict[str, Any]] = json.loads(FILE.read_text())["actions"]


def test_buttons_cover_every_action_once() -> None:
    assert sorted(a["param1"] for a in ACTIONS) == sorted(OperatorAction)


@pytest.mark.parametrize("button", ACTIONS, ids=lambda b: b["label"])
def test_button_gives_the_order_on_its_label(button: dict[str, Any]) -> None:
    fields = {
        "target_system": 1,
        "target_component": button["compId"],
        "command": button["mavCmd"],
        "param1": button["param1"],
        "param2": 0.0,
    }
    order = Conversations((1, 191)).take(fields, (255, 190), 10.0).command
    assert order is not None
    assert button["label"] == f"Alight: {order.action.name.lower()}"
    assert order.height_m is None
