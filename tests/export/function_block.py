"""Structured text executed: a strict translator of the small part of IEC 61131-3 that the export uses."""

from __future__ import annotations

import math
import re

_DECLARATION = re.compile(r"    ([a-z][a-z0-9_]*) : (LREAL|LINT|BOOL) := (TRUE|FALSE|-?\d+(?:\.\d+(?:E[+-]?\d+)?)?);$")
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[a-z][a-z0-9_]*)|(?P<number>\d+\.\d+(?:E[+-]?\d+)?|\d+)"
    r"|(?P<word>AND|MIN|MAX|SIN|LINT_TO_LREAL)|(?P<sign><=|>=|<>|[-+*/<>=(),]))"
)
_PYTHON = {"AND": "and", "MIN": "min", "MAX": "max", "SIN": "sin", "LINT_TO_LREAL": "float", "=": "==", "<>": "!="}
#: Keywords and standard functions of IEC 61131-3 that no variable may be called, whatever its case.
_WORDS = """
abs acos action add and any array asin at atan bool by byte case configuration constant cos ctd ctu date delete div do dt else
elsif end eq exit exp expt f_edge false find for from function function_block ge gt if in initial_step insert int interval le left
len limit ln log lreal lt max mid min mod move mul mux ne not of on or priority program r_edge read_only real repeat replace
resource retain return right rol ror rs sel shl shr sin sint sqrt sr step string struct sub tan task then time to tof ton tp
transition true trunc type until var while with word write xor
"""
RESERVED = frozenset(_WORDS.split())


class FunctionBlock:
    """A function block run by translating its text to Python, refusing whatever the small part of the language used here does not hold."""

    def __init__(self, source: str, name: str = "BELTCOMM_CASCADE") -> None:
        assert source.isascii()
        assert not re.search(r"\(\*(?:(?!\*\)).)*\(\*", source, re.DOTALL), "comments stand in one another"
        code = [line.rstrip() for line in re.sub(r"\(\*.*?\*\)", "", source, flags=re.DOTALL).splitlines() if line.strip()]
        assert (code[0], code[-1]) == (f"FUNCTION_BLOCK {name}", "END_FUNCTION_BLOCK")
        self.values: dict[str, float | bool | int] = {}
        self.kinds: dict[str, str] = {}
        self.types: dict[str, str] = {}
        place = 1
        while code[place].startswith("VAR"):
            kind, place = code[place], place + 1
            while code[place] != "END_VAR":
                match = _DECLARATION.match(code[place])
                assert match, code[place]
                name, type_, value = match.groups()
                assert name not in self.values
                assert name not in RESERVED
                assert type_ == ("BOOL" if value in ("TRUE", "FALSE") else "LREAL" if "." in value else "LINT")
                self.types[name], self.kinds[name] = type_, kind
                self.values[name] = value == "TRUE" if type_ == "BOOL" else float(value) if type_ == "LREAL" else int(value)
                place += 1
            place += 1
        body, depth = [], 0
        for line in (each.strip() for each in code[place:-1]):
            if match := re.fullmatch(r"(IF|ELSIF) (.*) THEN", line):
                depth -= match[1] == "ELSIF"
                body.append("    " * depth + ("if " if match[1] == "IF" else "elif ") + self._expression(match[2]) + ":")
                depth += 1
            elif line == "ELSE":
                body.append("    " * (depth - 1) + "else:")
            elif line == "END_IF;":
                depth -= 1
            else:
                match = re.fullmatch(r"([a-z][a-z0-9_]*) := (.*);", line)
                assert match, line
                assert self.kinds[match[1]] in ("VAR", "VAR_TEMP", "VAR_OUTPUT"), f"{match[1]} must not be written"
                assert self._type(match[2]) == self.types[match[1]], f"{line} mixes types"
                body.append("    " * depth + f"v['{match[1]}'] = {self._expression(match[2])}")
        assert depth == 0
        self._program = compile("\n".join(body), "function block", "exec")

    def _expression(self, source: str) -> str:
        """Python's form: its precedence is that of structured text for the signs allowed here."""
        words, place = [], 0
        while place < len(source):
            match = _TOKEN.match(source, place)
            assert match, f"not understood: {source[place:]}"
            place = match.end()
            if match["name"]:
                assert match["name"] in self.kinds, f"{match['name']} is not declared"
                words.append(f"v['{match['name']}']")
            else:
                words.append(_PYTHON.get(match[0].strip(), match[0].strip()))
        return " ".join(words)

    def _type(self, source: str) -> str:
        """LREAL or LINT: in structured text nothing becomes the other by itself."""
        outside = re.sub(r"LINT_TO_LREAL\([^()]*\)", "1.0", source)
        found = {self.types[name] for name in re.findall(r"\b[a-z][a-z0-9_]*", outside)}
        found |= {"LREAL" if "." in text else "LINT" for text in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", outside)}
        assert len(found) == 1, f"{source} mixes {found}"
        return found.pop()

    def call(self, **inputs: float | bool) -> float:
        """One call; its torque."""
        self.run(**inputs)
        return float(self.values["torque_nm"])

    def run(self, **inputs: float | bool) -> None:
        assert all(self.kinds[name] == "VAR_INPUT" for name in inputs)
        # temporary variables begin anew at every call: an old value must not be read
        for name in [name for name, kind in self.kinds.items() if kind == "VAR_TEMP"]:
            self.values[name] = float("nan")
        self.values.update(inputs)
        known = {"min": min, "max": max, "sin": math.sin, "float": float}
        exec(self._program, {"v": self.values, **known, "__builtins__": {}})
