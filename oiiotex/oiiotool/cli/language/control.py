# SPDX-License-Identifier: Apache-2.0
"""Control flow and variables: --if, --while, --for, --set; evaluation of expressions."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ....engine.core.attributes import attribute_value
from ....engine.core.parameters import Numbers, Parameter, param
from ....engine.deferred import oiio
from ....engine.errors import ParameterError
from ..stack.chain import Chain
from ..stack.output_settings import set_text, state, switch
from .parse import Option, whole_number


@dataclass
class Block:
    """An open --if, --while or --for."""

    name: str
    start: int  # the step that opened it
    outer: bool  # whether the steps around it are skipped
    holds: bool  # whether its condition is true
    rounds: int = 0  # of --while so far


MOST_ROUNDS = 100_000  # of a loop, without --maxloop

_FALSE = ("", "0", "false", "no", "off", "f", "n")


def truth(text: str) -> bool:
    """Whether a text is true as a condition: an empty one, 0, false, no and off are not."""
    bare = text.strip().lower()
    try:
        return float(bare) != 0
    except ValueError:
        return bare not in _FALSE


def _open(chain: Chain, name: str, holds: bool) -> None:
    chain.loops.append(Block(name, chain.position - 1, chain.skipping, holds))
    chain.skipping = chain.skipping or not holds


def _innermost(chain: Chain, name: str, end: str) -> Block:
    if not chain.loops or chain.loops[-1].name != name:
        raise ParameterError(f"{end} without {name}")
    return chain.loops[-1]


def _close(chain: Chain, name: str, end: str) -> Block:
    block = _innermost(chain, name, end)
    chain.loops.pop()
    chain.skipping = block.outer
    return block


def begin_if(chain: Chain, value: str) -> None:
    """Run the steps up to --else or --endif if VALUE is true: not empty, 0, false, no or off."""
    _open(chain, "--if", not chain.skipping and truth(chain.expressed(value)))


def otherwise(chain: Chain) -> None:
    """Run the steps up to --endif if the VALUE of --if is false."""
    block = _innermost(chain, "--if", "--else")
    block.holds = not block.holds
    chain.skipping = block.outer or not block.holds


def end_if(chain: Chain) -> None:
    """End --if."""
    _close(chain, "--if", "--endif")


def begin_while(chain: Chain, value: str) -> None:
    """Run the steps up to --endwhile repeatedly while VALUE is true."""
    holds = not chain.skipping and truth(chain.expressed(value))
    if not (chain.loops and chain.loops[-1].start == chain.position - 1):
        return _open(chain, "--while", holds)
    block = chain.loops[-1]
    most = chain.settings.get("--maxloop", MOST_ROUNDS)
    if holds and block.rounds >= most:
        raise ParameterError(f"{value} is still true after {most} iterations", hint="raise --maxloop")
    block.holds = holds
    chain.skipping = block.outer or not holds
    return None


def end_while(chain: Chain) -> None:
    """End --while."""
    block = _innermost(chain, "--while", "--endwhile")
    if block.holds and not block.outer:
        block.rounds += 1
        chain.position = block.start
    else:
        _close(chain, "--while", "--endwhile")


_RANGE = Parameter("RANGE", (Numbers,), None, "")


def begin_for(chain: Chain, variable: str, text: str) -> None:
    """Run the steps up to --endfor for each number of a range: END, START,END or START,END,STEP (END excluded)."""
    again = bool(chain.loops) and chain.loops[-1].start == chain.position - 1
    if chain.skipping and not again:
        return _open(chain, "--for", False)
    variable, text = chain.expressed(variable), chain.expressed(text)
    _check_name(variable)
    value, limit, step = _range(text)
    if again:
        block = chain.loops[-1]
        value = float(chain.user.get(variable, value)) + step
        block.holds = value < limit if step > 0 else value > limit
        chain.skipping = block.outer or not block.holds
    else:
        most = chain.settings.get("--maxloop", MOST_ROUNDS)
        if abs(limit - value) > most * abs(step):
            raise ParameterError(f"'{text}': expected at most {most} iterations", hint="raise --maxloop")
        _open(chain, "--for", value < limit if step > 0 else value > limit)
    chain.user[variable] = int(value) if float(value).is_integer() else value
    return None


def _range(text: str) -> tuple[float, float, float]:
    """'END', 'START,END' or 'START,END,STEP'."""
    numbers = tuple(_RANGE.parse(text))
    value, limit = (0.0, numbers[0]) if len(numbers) == 1 else numbers[:2]
    step = numbers[2] if len(numbers) == 3 else 1.0 if limit >= value else -1.0
    if len(numbers) > 3 or step == 0 or (limit - value) * step < 0:
        raise ParameterError(f"'{text}': expected END, START,END or START,END,STEP, with a step toward END")
    return value, limit, step


def end_for(chain: Chain) -> None:
    """End --for."""
    block = _innermost(chain, "--for", "--endfor")
    if block.holds and not block.outer:
        chain.position = block.start
    else:
        _close(chain, "--for", "--endfor")


def _check_name(name: str) -> None:
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise ParameterError(f"'{name}': expected a name of a variable: letters, digits and _")


@dataclass(frozen=True)
class SetModifiers:
    """Modifiers of --set, --oiioattrib and --iconfig."""

    type: str | None = param(None, unset="by the value", example="float", help="Type of the value: int, float ...")


def set_variable(chain: Chain, name: str, text: str, given: SetModifiers) -> None:
    """Set a variable for expressions."""
    _check_name(name)
    value = attribute_value(text, given.type)
    chain.user[name] = value if isinstance(value, (int, float, str)) else text


def set_oiio_attribute(chain: Chain, name: str, text: str, given: SetModifiers) -> None:
    """Set an attribute of OpenImageIO itself, for the whole process."""
    value = attribute_value(text, given.type)
    kind = oiio.TypeDesc(given.type or {int: "int", float: "float"}.get(value.__class__, "string"))
    before = oiio.getattribute(name, kind)
    if before is None:
        raise ParameterError(f"{name}: expected an attribute of OpenImageIO of type {kind}")
    chain.set_global(name, kind, value, before)


_OFF, _ON = "Take braces literally from here on", "Evaluate expressions in braces from here on (default)"
OPTIONS = (
    Option("--set NAME VALUE", set_variable, SetModifiers, state=True),
    Option("--if VALUE", begin_if, control=True),
    Option("--else", otherwise, control=True),
    Option("--endif", end_if, control=True),
    Option("--while VALUE", begin_while, control=True),
    Option("--endwhile", end_while, control=True),
    Option("--for VARIABLE RANGE", begin_for, control=True),
    Option("--endfor", end_for, control=True),
    Option("--evaloff", lambda chain: setattr(chain, "evaluating", False), text=_OFF, state=True),
    Option("--evalon", lambda chain: setattr(chain, "evaluating", True), text=_ON, state=True),
    Option("--oiioattrib NAME VALUE", set_oiio_attribute, SetModifiers, state=True),
)

_SAY = "Log each step, and measure the results"
_MAXLOOP = f"Set the maximum number of iterations of a loop. Default: {MOST_ROUNDS}"
_IGNORED = "Accepted and ignored, for oiiotool compatibility"
STATES = (
    Option("-v", switch("-v"), text=_SAY, state=True, throughout=True, aliases=("--verbose",)),
    Option("--maxloop N", set_text("--maxloop", whole_number), text=_MAXLOOP, state=True),
    state("--no-error-exit", "Continue with the next step after an error"),
    state("--metamerge", "Give results the metadata of all their inputs"),
    state("--sansattrib", "Omit --attrib and --sattrib from --history"),
    Option("--autotile SIZE", lambda chain, size: None, text=_IGNORED, state=True),
    Option("--experimental", lambda chain: None, text=_IGNORED, state=True),
)
