"""The phone: commands in, answers and lines out."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from app.channels import Events, Topic
from app.errors import OperatorError
from app.log import get_logger
from app.messages import CommandAnswer, OperatorCommand, OperatorText, ParameterFinding, Severity
from app.ports import OperatorLink

log = get_logger("operator")


def parameter_texts(findings: Sequence[ParameterFinding]) -> list[OperatorText]:
    """What the phone is told of PX4's parameters at the start: each critical one, and how many others there are."""
    texts = [OperatorText(finding.brief, Severity.CRITICAL) for finding in findings if finding.critical]
    others = len(findings) - len(texts)
    if others:
        texts.append(OperatorText(f"PX4 parameters differ: {others}, run alight check", Severity.WARNING))
    return texts


async def run_operator(
    *,
    link: OperatorLink,
    commands: Topic[OperatorCommand],
    answers: Events[CommandAnswer],
    texts: Events[OperatorText],
) -> None:
    """Run until cancelled. A phone that can't be reached ends no flight: it is logged, and the next word is tried."""
    async with asyncio.TaskGroup() as group:
        group.create_task(_receive(link, commands))
        group.create_task(_answer(link, answers))
        group.create_task(_say(link, texts))


async def _receive(link: OperatorLink, commands: Topic[OperatorCommand]) -> None:
    async for command in link.commands():
        log.info("command.received", action=command.action.name, height_m=command.height_m, sender=command.sender)
        commands.publish(command)


async def _answer(link: OperatorLink, answers: Events[CommandAnswer]) -> None:
    while True:
        answer = await answers.get()
        try:
            await link.answer(answer)
        except OperatorError as error:
            log.warning("answer.lost", number=answer.number, result=answer.result.name, error=error.what)


async def _say(link: OperatorLink, texts: Events[OperatorText]) -> None:
    while True:
        text = await texts.get()
        try:
            await link.say(text)
        except OperatorError as error:
            log.warning("text.lost", text=text.text, error=error.what)
