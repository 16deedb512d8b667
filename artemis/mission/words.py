"""The words that compose a mission's steps, as its file writes them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, ValidationInfo, model_validator
from pydantic.json_schema import SkipJsonSchema

from artemis.config import Config, Inconsistent
from artemis.mission.actions import (
    A_LIST,
    Ask,
    Calibrate,
    ConditionText,
    FileName,
    Follow,
    Stop,
    Teleop,
    Text,
    Wait,
)
from artemis.mission.goto import Goto
from artemis.mission.keys import Positive, check_one_key
from artemis.mission.problems import NO_ELSE, describe, nearest
from artemis.plugins.registry import BEHAVIOURS, names
from artemis.yaml_file import KeyPath

Steps = Annotated[tuple["Step", ...], *A_LIST]
Outcome = Annotated[str, Field(min_length=1, max_length=64)]


def _named(argument: str) -> str:
    if not argument.isidentifier():
        raise ValueError("the name of an argument begins with a letter or _, and has only these and digits")
    return argument


Argument = Annotated[str, AfterValidator(_named)]


class RepeatWord(Config):
    """Do the steps again and again: so often, or until a condition holds; without either for ever."""

    steps: Steps
    """What is repeated."""
    times: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """How often."""
    until: ConditionText | None = None
    """Asked between two rounds."""


class TryWord(Config):
    """Do the steps; catch outcomes other than `done`."""

    steps: Steps
    """What is tried."""
    retries: Annotated[int, Field(ge=0, le=1000)] = 0
    """So often the steps are begun anew after an outcome of `again_on`."""
    again_on: Annotated[tuple[Outcome, ...], *A_LIST] | None = None
    """Outcomes that are worth a retry; if left out: all but faults."""
    between: Steps | None = None
    """Done before each retry."""
    catch: dict[Outcome, Steps] = Field(default_factory=dict)
    """By outcome, what is done then; `any`: the rest, but of faults only those that `again_on` names. An outcome that
    no `try` catches ends the mission."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.retries and not self.catch:
            raise ValueError("neither retries nor catch: it does nothing; write one of them, or the steps alone")
        if not self.retries and (self.again_on is not None or self.between is not None):
            raise ValueError("again_on and between belong to retries: write how many")
        return self


class WatchWord(Config):
    """What is done once a condition becomes true while steps run: the robot comes to rest first."""

    if_: ConditionText = Field(alias="if")
    """When it becomes true, this is done; it must be false once before it is done again."""
    steps: Steps | None = None
    """What is done; nothing: only `then`."""
    then: Outcome = "resume"
    """resume where it was; restart the steps; or an outcome of your own."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.steps is None and self.then == "resume":
            raise ValueError("neither steps nor then: it does nothing")
        return self


class DuringWord(Config):
    """Watch while the steps run."""

    steps: Steps
    """While these run."""
    at_most_s: Positive | None = None
    """After so long they end with the outcome `timeout`; time in which the mission does not run does not count."""
    when: Annotated[tuple[WatchWord, ...], Field(strict=False)] = ()
    """What is watched; the first that becomes true is done."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.at_most_s is None and not self.when:
            raise ValueError("neither at_most_s nor when: it watches nothing")
        return self


class BranchWord(Config):
    """Steps that are done if a condition holds; without one, always."""

    if_: ConditionText | None = Field(default=None, alias="if")
    """If left out, always; only in the last branch."""
    steps: Steps
    """What is done then."""


class TogetherWord(Config):
    """Do the steps, and others beside that do not move the robot."""

    steps: Steps
    """Over when these are."""
    beside: Steps
    """Each by itself; an outcome other than `done` ends all."""


class CallWord(Config):
    """Put the steps of a part in here."""

    part: str
    """Its name under `parts`."""
    with_: dict[str, Any] = Field(default_factory=dict, alias="with")
    """Its arguments."""
    steps: SkipJsonSchema[Annotated[tuple[Step, ...], Field(strict=False)]] = ()


class EndWord(Config):
    """End the mission: stand, drives off."""

    outcome: Literal["done", "failed"] = "done"
    """failed: exit status 1."""
    say: Text | None = None
    """The message that is shown to the operator."""


class MissionPart(Config):
    """Steps that are written once; `$name` in them stands for an argument."""

    file: FileName | None = None
    """Instead of the other keys: a file that has these, for several missions."""
    takes: dict[Argument, Any] = Field(default_factory=dict)
    """Arguments with their defaults; nothing: it has to be given."""
    steps: Annotated[list[dict[str, Any]], Field(min_length=1)] | None = None
    """As in a mission, with `$name` for the argument `name`."""

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.file is None) == (self.steps is None) or (self.file is not None and self.takes):
            raise ValueError("a part has either file, or steps (and takes)")
        return self


def _text_too(schema: dict[str, Any]) -> None:
    schema["anyOf"] = [{"type": "string"}, *schema["anyOf"]]


class Step(Config):
    """One step of the mission: a mapping with exactly one key, one of these or the name of a behaviour."""

    model_config = ConfigDict(extra="allow", json_schema_extra={"minProperties": 1, "maxProperties": 1})
    calibrate: Calibrate | None = None
    follow: Follow | None = None
    goto: Goto | None = None
    wait: Wait | None = None
    teleop: Teleop | None = None
    ask: Ask | None = None
    say: Text | None = None
    """Show a message to the operator."""
    repeat: RepeatWord | None = None
    try_: TryWord | None = Field(default=None, alias="try")
    during: DuringWord | None = None
    choose: Annotated[tuple[BranchWord, ...], *A_LIST] | None = None
    """Do the first branch whose condition holds; without `if` it always does."""
    together: TogetherWord | None = None
    call: CallWord | None = Field(default=None, json_schema_extra=_text_too)
    """A part by its name, or {part: NAME, with: {ARGUMENT: VALUE}}."""
    end: EndWord | None = None
    stop: Stop | None = None

    @property
    def word(self) -> str:
        """Its only key."""
        (key,) = self.model_fields_set
        return self.behaviour or key.removesuffix("_")

    @property
    def action(self) -> Any:  # noqa: ANN401 (of each word another)
        """What the only key holds."""
        (key,) = self.model_fields_set
        return self.model_extra[key] if self.model_extra else getattr(self, key)

    @property
    def behaviour(self) -> str:
        """The name of the behaviour that does it; empty: it is a step of artemis' own, or a word."""
        return next(iter(self.model_extra or ()), "")

    @model_validator(mode="after")
    def _one_key(self, info: ValidationInfo) -> Self:
        self._check_behaviours(info.context or partial(names, BEHAVIOURS))
        check_one_key(self, "a step")
        return self

    def _check_behaviours(self, installed: Callable[[], Collection[str]]) -> None:
        wrong: list[tuple[KeyPath, str]] = []
        for key, body in (self.model_extra or {}).items():
            if key == "else":
                wrong.append(((key,), NO_ELSE))
            elif key not in (names := installed()):
                own = [field.alias or name for name, field in type(self).model_fields.items()]
                near = nearest(key, list(dict.fromkeys([*own, *names])), "known keys")
                what = "unknown key" if "did you mean" in near else "unknown key, and no installed behaviour"
                wrong.append(((key,), f"{what}{near}"))
            elif body is not None and not isinstance(body, dict):
                wrong.append(((key,), f"expected a mapping, found {describe(body)}"))
        if wrong:
            raise Inconsistent(wrong)


for _word in (RepeatWord, TryWord, WatchWord, DuringWord, BranchWord, TogetherWord, CallWord):
    _word.model_rebuild()  # they were made before `Step`: whoever looks at their fields shall see it
