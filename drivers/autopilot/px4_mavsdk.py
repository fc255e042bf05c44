"""PX4 over MAVLink with MAVSDK: the Autopilot port on the real link.

Setpoints are our own SET_POSITION_TARGET_LOCAL_NED messages, each sent once; MAVSDK's Offboard plugin, which goes on
sending the last one by itself, is never made (decisions/0001). Telemetry is read raw, for the sake of the times since
boot that MAVSDK's telemetry plugin leaves out. This file moves messages; what they mean is telemetry's,
px4_commands' and boot_clock's.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import aclosing
from functools import partial
from types import TracebackType
from typing import Any, Self

from mavsdk.asyncio.plugins.events import EventsAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkDirectError, MavlinkMessage

from app.channels import Latest
from app.config import AutopilotConfig
from app.errors import AutopilotError
from app.log import get_logger
from app.messages import (
    AutopilotAction,
    CommandResult,
    LandingTarget,
    ParameterFinding,
    Setpoint,
    VehicleState,
)
from app.ports import always
from drivers.autopilot.command_channel import SENDS, CommandChannel, NoAnswerError
from drivers.autopilot.px4_commands import (
    SET_MESSAGE_INTERVAL,
    command_long,
    command_of,
    landing_target_fields,
    setpoint_fields,
)
from drivers.autopilot.px4_param_file import ParameterCheck
from drivers.autopilot.px4_params import Px4Parameters
from drivers.autopilot.px4_words import AUTOPILOT_COMPONENT, Px4Words
from drivers.autopilot.setpoint_channel import CLOSE_MAX_S, SetpointChannel
from drivers.autopilot.telemetry import NAMES, VehicleTelemetry
from drivers.mavsdk_session import COMPONENT_ID, MavsdkSession, encode, messages

QUIET_S = 0.4
"""Without an attitude for this long, the newest state is given again."""
LOST_S = 1.5
"""Without HEARTBEAT (1 Hz) and attitude for this long, the link is lost."""
REOPEN_AFTER_S = 3.0
"""A serial port is closed and opened again after this long without a word."""
ALTITUDE_AGE_MAX_S = 3.0
WARM_UP_STATES = 10
"""Attitudes that settle the clock's offset before the first state is given out."""

_log = get_logger("autopilot")


class Px4Autopilot:
    """PX4 on a MAVLink address, opened once. Its times, and those of setpoints, are CLOCK_MONOTONIC (time.monotonic).

    Args:
        config: Address, rates and time limits.
        check: What PX4's parameters have to be; None: they are not read.

    Attributes:
        setpoints: How they leave; counts those sent and dropped.
        targets: The same of landing targets.
    """

    def __init__(self, config: AutopilotConfig, check: ParameterCheck | None = None) -> None:
        self._config = config
        self._telemetry = VehicleTelemetry()
        self._session = MavsdkSession(config.address, 1, AutopilotError)
        self._commands = CommandChannel(partial(self._send, "COMMAND_LONG"))
        self._parameters = Px4Parameters(check, self._request_parameter)
        self._direct: Any = None
        self._words: Px4Words | None = None
        self._background: asyncio.Task[None] | None = None
        self._readers: list[Latest[VehicleState | None]] = []
        self._sending: set[asyncio.Task[None]] = set()
        self._newest: VehicleState | None = None
        self._states_seen = 0
        self._warm = asyncio.Event()
        self._rates_wanted = asyncio.Event()
        self._rates_set = asyncio.Event()
        self.setpoints = SetpointChannel()
        self.targets = SetpointChannel()

    @property
    def session(self) -> MavsdkSession:
        """The open link, for a phone that is reached through the autopilot."""
        return self._session

    @property
    def system_id(self) -> int:
        """MAVLink system id of the drone, which is ours too; known once open."""
        return self._session.system_id

    @property
    def parameter_findings(self) -> tuple[ParameterFinding, ...]:
        """PX4's failsafe parameters that are not as they have to be, critical ones first; of the newest reading."""
        return self._parameters.findings

    # ----------------------------------------------------------------------------------------------- open and close
    async def __aenter__(self) -> Self:
        """Connect, ask for the telemetry rates and PX4's failsafe parameters, and wait for the first attitudes.

        Raises:
            AutopilotError: The address can't work, no autopilot answers, or it sends no attitude.
        """
        try:
            await self._open()
        except BaseException:
            await self._close()
            raise
        _log.info("autopilot.connected", address=self._config.address, system_id=self.system_id)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop reading and destroy the link."""
        await self._close()

    async def _open(self) -> None:
        deadline_s = time.monotonic() + self._config.connect_timeout_s
        system = await self._find(deadline_s)
        system_id = await system.get_system_id()
        if system_id != self._session.system_id:
            # Our system id must be the drone's, and MAVSDK takes it at the start only.
            await self._session.close()
            self._session = MavsdkSession(self._config.address, system_id, AutopilotError)
            system = await self._find(deadline_s + 5.0)
        self._direct = MavlinkDirectAsync(system)
        self._words = Px4Words(self._direct, EventsAsync(system))
        self._rates_wanted.set()
        self._background = asyncio.create_task(self._run(self._words), name="autopilot")
        self._background.add_done_callback(self._on_background_done)
        try:
            async with asyncio.timeout(max(5.0, deadline_s - time.monotonic())):
                await self._warm.wait()
                await self._rates_set.wait()
        except TimeoutError:
            raise AutopilotError(
                f"{self._config.address}: system {self.system_id} answers but sends no attitude",
                "wait until its estimator runs, and see that its MAVLink instance is in mode Onboard",
            ) from None
        await self._parameters.wait_until_read()

    async def _find(self, deadline_s: float) -> Any:
        await self._session.open()
        system = await self._session.mavsdk.first_autopilot(max(0.1, deadline_s - time.monotonic()))
        if system is None:
            address = self._config.address
            do = (
                "check the wiring (TX to RX), the baud rate and PX4's MAV_1_CONFIG"
                if address.startswith("serial")
                else "start PX4, check the port, and see that no other program takes its packets"
            )
            raise AutopilotError(f"{address}: no autopilot's heartbeat within {self._config.connect_timeout_s:g} s", do)
        return system

    async def _close(self) -> None:
        background, self._background = self._background, None
        if background is not None:
            background.cancel()
            await asyncio.wait({background})
        self._direct = self._words = None
        # A call of MAVSDK's that is under way on a thread would crash in an instance that is gone.
        await self.setpoints.close()
        await self.targets.close()
        if self._sending:
            await asyncio.wait(self._sending, timeout=CLOSE_MAX_S)
        await self._session.close()

    # ------------------------------------------------------------------------------------------------------ reading
    async def states(self) -> AsyncIterator[VehicleState]:
        """The newest state at each attitude, and at least twice a second while none comes.

        Raises:
            AutopilotError: The link is closed.
        """
        queue: Latest[VehicleState | None] = Latest("vehicle")
        self._readers.append(queue)
        if self._newest is not None:
            queue.put_newest(self._newest)
        try:
            while self._background is not None:
                state = await queue.get()
                if state is None:
                    break
                yield state
        finally:
            self._readers.remove(queue)
        raise AutopilotError(f"{self._config.address}: the link was closed", "start again")

    def _publish(self, state: VehicleState | None) -> None:
        if state is not None:
            self._newest = state
        for queue in self._readers:
            queue.put_newest(state)

    def _on_background_done(self, task: asyncio.Task[None]) -> None:
        """Readers end with the background; what ended it is told by its own exception."""
        self._publish(None)
        if not task.cancelled() and task.exception() is not None:
            _log.error("autopilot.failed", error=repr(task.exception()))

    async def _run(self, words: Px4Words) -> None:
        async with asyncio.TaskGroup() as group:
            for name in NAMES:
                group.create_task(self._read(name), name=f"autopilot-{name}")
            group.create_task(self._read_acks(), name="autopilot-acks")
            values = messages(self._direct, "PARAM_VALUE")
            group.create_task(self._parameters.run(values, self.system_id), name="autopilot-parameters")
            group.create_task(words.run(), name="autopilot-words")
            group.create_task(self._watch(), name="autopilot-watch")
            group.create_task(self._keep_rates(), name="autopilot-rates")

    async def _read(self, name: str) -> None:
        sender = (self.system_id, AUTOPILOT_COMPONENT)
        async with aclosing(messages(self._direct, name)) as stream:
            async for message in stream:
                if (message.system_id, message.component_id) != sender:
                    continue
                state = self._telemetry.take(message.name, message.fields, time.monotonic())
                if state is not None:
                    self._states_seen += 1
                    if self._states_seen >= WARM_UP_STATES:
                        self._warm.set()
                        self._publish(state)
                # One message a turn: after a stall the streams go on abreast, and each attitude meets its position.
                await asyncio.sleep(0)

    async def _watch(self) -> None:
        """Give the state again while no attitude comes; see the link lost and regained; re-open a dead serial port."""
        connected, restarts, reopened_s = True, 0, time.monotonic()
        while True:
            await asyncio.sleep(QUIET_S / 2.0)
            now_s = time.monotonic()
            silent_s = now_s - self._telemetry.last_heard_s
            was_connected, connected = connected, silent_s < LOST_S
            if was_connected and not connected:
                _log.warning("autopilot.lost", silent_s=round(silent_s, 2))
            if connected and not was_connected:
                _log.info("autopilot.regained")
            if self._telemetry.clock.restarts != restarts or (connected and not was_connected):
                restarts = self._telemetry.clock.restarts
                self._rates_wanted.set()
                self._parameters.read_again()
            newest_s = self._newest.t_capture_s if self._newest is not None else now_s
            if now_s - newest_s > QUIET_S or not connected:
                self._publish_again(connected=connected)
            serial = self._config.address.startswith("serial")
            if serial and silent_s > REOPEN_AFTER_S and now_s - reopened_s > REOPEN_AFTER_S:
                reopened_s = now_s
                await self._session.reconnect()

    def _publish_again(self, *, connected: bool) -> None:
        state = self._telemetry.without_attitude(connected=connected)
        if state is not None:
            self._publish(state)

    async def _keep_rates(self) -> None:
        """Ask for the telemetry rates now, and again after a loss or a restart of the autopilot."""
        fast_hz = self._config.telemetry_rate_hz
        rates_hz = {31: fast_hz, 32: fast_hz, 436: 10.0, 245: 20.0, 1: 5.0, 230: 5.0, 33: 2.0}
        while True:
            await self._rates_wanted.wait()
            self._rates_wanted.clear()
            for message_id, rate_hz in rates_hz.items():
                params = (float(message_id), 1e6 / rate_hz)
                try:
                    result = await self._command(command_long(self.system_id, SET_MESSAGE_INTERVAL, *params))
                except NoAnswerError:
                    result = "no answer"
                if result != CommandResult.ACCEPTED.name:
                    _log.warning("telemetry.rate_refused", message_id=message_id, rate_hz=rate_hz, result=result)
            self._rates_set.set()

    # ----------------------------------------------------------------------------------------------------- commanding
    async def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send a velocity, acceleration and yaw in PX4's local frame, once, if it is fresh (see setpoint_channel).

        Raises:
            ValueError: The setpoint isn't finite.
            AutopilotError: The link is closed.
        """
        boot_s = self._telemetry.clock.to_boot_s(setpoint.t_s)
        fields = setpoint_fields(setpoint, self.system_id, boot_s)
        await self.setpoints.send(self._put("SET_POSITION_TARGET_LOCAL_NED", fields), setpoint.t_s)

    async def send_landing_target(self, target: LandingTarget) -> None:
        """Send where the pad is in PX4's local frame, once, if it is fresh.

        Raises:
            ValueError: The target isn't finite.
            AutopilotError: The link is closed.
        """
        epoch_s = time.time() - (time.monotonic() - target.t_s)
        await self.targets.send(self._put("LANDING_TARGET", landing_target_fields(target, epoch_s)), target.t_s)

    def _put(self, name: str, fields: dict[str, Any]) -> Callable[[], str]:
        """What puts a message on the wire, on a thread of its own; it returns "" or what went wrong."""
        direct = self._open_direct()
        message = MavlinkMessage(name, 0, 0, self.system_id, AUTOPILOT_COMPONENT, encode(fields))

        def put() -> str:
            try:
                # The plugin's blocking call: its coroutine would queue behind other calls in the loop's executor.
                direct._plugin.send_message(message)  # noqa: SLF001  # there is no public blocking call
            except MavlinkDirectError as fault:
                return str(fault.result.name)
            return ""

        return put

    async def execute(
        self,
        action: AutopilotAction,
        *,
        height_m: float = 0.0,
        asked_s: float | None = None,
        wanted: Callable[[], bool] = always,
    ) -> None:
        """Run an action to PX4's answer, within action_timeout_s. TAKEOFF climbs to height_m above the present height.

        The answer is PX4's acceptance; that the mode has changed is seen in states().

        Raises:
            AutopilotError: PX4 refused (with its words), gave no answer in time, or the link is closed.
        """
        self._open_direct()
        if action is AutopilotAction.ARM and (reason := self._parameters.reason_not_to_arm()):
            raise AutopilotError(f"PX4's failsafe parameters: {reason}", "load deploy/px4/alight.params into PX4")
        start_s = time.monotonic()
        fields = command_of(action, self.system_id, self._takeoff_amsl_m(action, height_m, start_s))
        try:
            async with asyncio.timeout(self._config.action_timeout_s):
                # A forced disarm was judged for this instant: the mission asks again, if it is right then.
                result = await self._command(fields, 1 if action is AutopilotAction.FORCE_DISARM else SENDS)
        except TimeoutError:
            raise AutopilotError(
                f"PX4 gave no final answer to {action.value} within {self._config.action_timeout_s:g} s",
                "check the link",
            ) from None
        except NoAnswerError:
            raise AutopilotError(f"PX4 did not answer {action.value}", "check the link") from None
        if result != CommandResult.ACCEPTED.name:
            said = await self._reasons(action, start_s)
            raise AutopilotError(f"PX4 refused to {action.value} ({result}){said}", "see what PX4 says")
        if action in (AutopilotAction.ARM, AutopilotAction.DISARM, AutopilotAction.FORCE_DISARM):
            self._telemetry.note_armed(action is AutopilotAction.ARM)

    async def _reasons(self, action: AutopilotAction, start_s: float) -> str:
        """What PX4 said of a refusal, to follow it in a sentence; "" if nothing."""
        if self._words is None:
            return ""
        words = await self._words.since(start_s)
        if action is AutopilotAction.ARM:
            words += await self._words.arming_problems()
        return f": {'; '.join(words)}" if words else ""

    def _takeoff_amsl_m(self, action: AutopilotAction, height_m: float, now_s: float) -> float:
        if action is not AutopilotAction.TAKEOFF:
            return 0.0
        altitude = self._telemetry.altitude_amsl_m
        if altitude is None or now_s - altitude[1] > ALTITUDE_AGE_MAX_S:
            raise AutopilotError(
                "PX4 gives no height above sea level (GLOBAL_POSITION_INT), which its take-off wants",
                "wait for a GNSS fix",
            )
        return altitude[0] + height_m

    async def _command(self, fields: dict[str, Any], sends: int = SENDS) -> str:
        """Send a COMMAND_LONG and return the name of the autopilot's final MAV_RESULT.

        Raises:
            NoAnswerError: No answer came.
        """
        result = await self._commands.run(fields, sends)
        known = {r.value: r.name for r in CommandResult}
        return known.get(result, f"MAV_RESULT {result}")

    async def _request_parameter(self, name: str) -> None:
        target = {"target_system": self.system_id, "target_component": AUTOPILOT_COMPONENT}
        await self._send("PARAM_REQUEST_READ", {**target, "param_id": name, "param_index": -1})

    async def _send(self, name: str, fields: Mapping[str, Any]) -> None:
        message = MavlinkMessage(name, 0, 0, self.system_id, AUTOPILOT_COMPONENT, encode(dict(fields)))
        sending = asyncio.create_task(self._open_direct().send_message(message), name="autopilot-send")
        self._sending.add(sending)
        sending.add_done_callback(self._sent)
        try:
            await asyncio.shield(sending)  # its thread can't be cancelled
        except MavlinkDirectError as fault:
            # Not an end: it is sent again, and a link that stays down shows as no answer.
            _log.debug("message.not_sent", name=name, command=fields.get("command"), fault=fault.result.name)

    def _sent(self, sending: asyncio.Task[None]) -> None:
        self._sending.discard(sending)
        if not sending.cancelled():
            sending.exception()  # of a command that nobody waits for any more

    async def _read_acks(self) -> None:
        ours = ((self.system_id, COMPONENT_ID), (self.system_id, 0), (0, 0))
        async with aclosing(messages(self._direct, "COMMAND_ACK")) as stream:
            async for message in stream:
                fields = message.fields
                if (int(fields["target_system"]), int(fields["target_component"])) in ours:
                    self._commands.take_ack(fields)

    def _open_direct(self) -> Any:
        if self._direct is None:
            raise AutopilotError(f"{self._config.address}: the link is closed", "open it first")
        return self._direct
