"""Structured text executed: a strict translator of the small part of IEC 61131-3 that the export uses."""

from __future__ import annotations

import re

_DECLARATION = re.compile(r"    ([a-z][a-z0-9_]*) : (LREAL|BOOL) := (TRUE|FALSE|-?\d+\.\d+(?:E[+-]?\d+)?);$")
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[a-z][a-z0-9_]*)|(?P<number>\d+\.\d+(?:E[+-]?\d+)?)|(?P<word>AND|MIN|MAX)|(?P<sign><=|>=|[-+*/<>(),]))"
)
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

    def __init__(self, source: str) -> None:
        assert source.isascii()
        assert not re.search(r"\(\*(?:(?!\*\)).)*\(\*", source, re.DOTALL), "comments stand in one another"
        code = [line.rstrip() for line in re.sub(r"\(\*.*?\*\)", "", source, flags=re.DOTALL).splitlines() if line.strip()]
        assert (code[0], code[-1]) == ("FUNCTION_BLOCK BELTCOMM_CASCADE", "END_FUNCTION_BLOCK")
        self.values: dict[str, float | bool] = {}
        self.kinds: dict[str, str] = {}
        place = 1
        while code[place].startswith("VAR"):
            kind, place = code[place], place + 1
            while code[place] != "END_VAR":
                match = _DECLARATION.match(code[place])
                assert match, code[place]
                name, type_, value = match.groups()
                assert name not in self.values
                assert name not in RESERVED
                assert (type_ == "BOOL") == (value in ("TRUE", "FALSE"))
                self.values[name], self.kinds[name] = value == "TRUE" if type_ == "BOOL" else float(value), kind
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
                words.append({"AND": "and", "MIN": "min", "MAX": "max"}.get(match[0].strip(), match[0].strip()))
        return " ".join(words)

    def call(self, **inputs: float | bool) -> float:
        assert all(self.kinds[name] == "VAR_INPUT" for name in inputs)
        # temporary variables begin anew at every call: an old value must not be read
        for name in [name for name, kind in self.kinds.items() if kind == "VAR_TEMP"]:
            self.values[name] = float("nan")
        self.values.update(inputs)
        exec(self._program, {"v": self.values, "min": min, "max": max, "__builtins__": {}})
        return float(self.values["torque_nm"])
