"""Errors of TOML syntax in plain words, with the line and how to write it. tomllib's own words do not say what to do."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable

from softlab.model.base.errors import shown

PLACE = re.compile(r" \((?:at line (\d+), column (\d+)|at end of document)\)$")
FIELD = re.compile(r"\s*([\w.\"'-]+)\s*=")
END = r"(?=\s*(?:#.*)?$)"  # of a line, before a comment
NUMBER = r"[+-]?[\d.]+(?:[eE][+-]?\d+)?"
LONGEST_LINE = 200  # characters: in longer lines patterns are slow, and a correction would not be readable
CLOSING = {"[": "]", "{": "}"}


def _table(match: re.Match[str]) -> str:
    return "[" + re.sub(r"[^\w.-]+", "_", match[1]) + "]"


def _closed(match: re.Match[str]) -> str:
    """Return the line with the brackets that it does not close, closed."""
    line, comment = match[1], match[2]
    expected: list[str] = []
    for letter in re.sub(r"\"[^\"]*\"|'[^']*'", "", line):
        if letter in CLOSING:
            expected.append(CLOSING[letter])
        elif expected and letter == expected[-1]:
            expected.pop()
    return line.rstrip(" ,") + "".join(reversed(expected)) + comment


# pattern of a mistake in a line, what takes its place, and the rule in words; a line may contain several mistakes
RULES: tuple[tuple[str, str | Callable[[re.Match[str]], str], str], ...] = (
    (r"^(?://|;|--|/\*)\s*(.*)$", r"# \1", "a comment begins with #"),
    (r"[\u00a0\u2000-\u200b\u202f\u3000\ufeff]", " ", "there is an invisible character that is not a space"),
    (r"[\u00ab\u00bb\u201c-\u201f]", '"', 'quotes are straight: "'),
    (r"[\u2018-\u201b]", "'", "quotes are straight: '"),
    (r"^\[+\s*([\w.-]+)\s*\]*$", r"[\1]", "the name of a table stands in brackets"),
    (r"^([\w.-]+):$", r"[\1]", "the name of a table stands in brackets"),
    (r"^\[+([^\[\]=]*[^\[\]=\s])\s*\]*$", _table, "the name of a table has no spaces"),
    (r"^(\[[^\[\]]+\])\s*([^\s#].*)$", r"\1\n\2", "the fields of a table stand on the lines below it"),
    (r"^([\w.-]+)\s*:=?\s*(\S.*)$", r"\1 = \2", "a field and its value are separated by ="),
    (r"^([\w.-]+)\s+(?!=)(\S.*)$", r"\1 = \2", "a field and its value are separated by ="),
    (r"^([\w.-]+)\s*==+", r"\1 =", "a field and its value are separated by ="),
    (r"=\s*(?:None|null|nil)\b.*$", "", "a field without a value is left out: delete this line"),
    (r"=" + END, "", "there is no value: give one, or delete this line"),
    (r"(=\s*)(?:True|TRUE|yes|on)" + END, r"\1true", "true and false are written in lower case"),
    (r"(=\s*)(?:False|FALSE|no|off)" + END, r"\1false", "true and false are written in lower case"),
    (r"(=\s*)\"([^\"#]*[^\"'#\s])'?" + END, r'\1"\2"', "a text ends with the quote that it begins with"),
    (r"(=\s*)'([^'#]*[^\"'#\s])\"?" + END, r"\1'\2'", "a text ends with the quote that it begins with"),
    (r"\\", "/", "a backslash in quotes has another meaning: use /"),
    (r"(=\s*[+-]?\d+),(\d+)" + END, r"\1.\2", "decimals are separated by a point"),
    (r"([{,][^={},]*=\s*[+-]?\d+),(\d+)(?=\s*[,}])", r"\1.\2", "decimals are separated by a point"),
    (r"([=\[,]\s*[+-]?)\.(\d)", r"\g<1>0.\2", "a digit stands on both sides of a decimal point"),
    (r"([=\[,]\s*[+-]?\d+)\.(?=\s*(?:[,\]#]|$))", r"\1.0", "a digit stands on both sides of a decimal point"),
    (r"([=\[,]\s*[+-]?)0+(\d)", r"\1\2", "a number does not begin with 0"),
    (r"[,;]" + END, "", "no comma or semicolon ends a line"),
    (r"^([^={\[]+=[^={\[]*?[^,;\s{\[])\s*[,;]?\s+([\w.-]+\s*=.*)$", r"\1\n\2", "each field has a line of its own"),
    (rf"^([\w.-]+\s*=\s*{NUMBER})\s*([^\s\d,\]}}#.][^,#]*)$", r"\1  # \2", "a number has no unit: put it in a comment"),
    (r"\(([^()]*)\)", r"[\1]", "lists stand in brackets: [ ]"),
    (r"(?<=[\d\"'\]])\s+(?=[\d\"'\[+-])", ", ", "values of a list are separated by commas"),
    (r"(=\s*[^\s,{}=]+)\s+(?=[\w.-]+\s*=)", r"\1, ", "fields in braces are separated by commas"),
    (r"^([^\[{]+=[^\[{#]*?)\s*[\]}]+" + END, r"\1", "a bracket or brace closes that was not opened"),
    (r"^(.*[\[{][^#]*?)(\s*(?:#.*)?)$", _closed, "a bracket or brace is not closed in its line"),
    (r"([=\[,]\s*)(?!(?:true|false|inf|nan)\b)([A-Za-z_./~][^,\]}\"'#=]*?)(?=\s*(?:[,\]}#]|$))", r'\1"\2"',
     "a word stands in quotes"),
)  # fmt: skip


def plain_error(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Return what is wrong with a text that is not TOML: the line, the rule that it breaks, and the line as it should
    be, if that is TOML; otherwise the words of tomllib."""
    if text.lstrip().startswith("{"):
        return "this is JSON; a scene has lines such as [grid] and, below it, rows = 32"
    lines, words = text.split("\n"), PLACE.sub("", str(error))
    number = _line_number(lines, str(error))
    line = lines[number - 1].strip(" \t") if number <= len(lines) else ""
    if words.startswith("Cannot"):
        fault = _twice(lines, number)
    elif words.startswith("Illegal character '\\n'"):
        fault = corrected(line) or "a quote is not closed"
    elif words.startswith("Unclosed array") and line.endswith((",", "[")):
        fault = "the list that begins here is not closed: a ] is missing"
    elif line.endswith((",", "{")) and "{" in line:
        fault = "all fields in braces stand in one line"
    else:
        fault = corrected(line) or words
    return f"line {number}: {shown(line)[1:-1]}: {fault}"


def _line_number(lines: list[str], message: str) -> int:
    """Return the number of the line with the mistake: of a list that is not closed, the line where it begins."""
    place = PLACE.search(message)
    if message.startswith("Unclosed array") and place and place[1] is None:
        return next((k for k in range(len(lines), 0, -1) if FIELD.match(lines[k - 1])), len(lines))
    if place is None or place[1] is None:  # a quote that is not closed: from its line on all is text
        odd = (k for k, line in enumerate(lines, 1) if re.search(r"=\s*('[^']*|'''.*|\"\"\".*)$", line))
        return next(odd, len(lines))
    number, column = int(place[1]), int(place[2])
    if message.startswith("Unclosed") and number <= len(lines) and not lines[number - 1][: column - 1].strip():
        return next((k for k in range(number - 1, 0, -1) if FIELD.match(lines[k - 1])), number)
    return number


def _twice(lines: list[str], number: int) -> str:
    """Return what to do about a field or a table that a text has twice."""
    line = lines[number - 1].strip()
    name = line.split("=")[0].split("#")[0].strip()
    if name.startswith("["):
        advice = f'give the second another name and, below it, kind = "{name.strip("[] ")}"; or join them'
    else:
        advice = "keep one of the two"
    same = [k for k, other in enumerate(lines[: number - 1], 1) if re.split("[=#]", other)[0].strip() == name]
    if not same:
        return f"{name} belongs to a name that has a value or fields already: write them in one place"
    return f"{name} is given twice, first in line {same[-1]}: {advice}"


def corrected(line: str) -> str:
    """Return the rules that a line breaks and the line as it should be, or "" if that is not known."""
    broken: list[str] = []
    if len(line) > LONGEST_LINE:
        return ""
    for pattern, replacement, rule in RULES:
        changed = re.sub(pattern, replacement, line)
        if changed == line:
            continue
        broken.append(rule)
        if replacement == "" and "delete" in rule:
            return ", and ".join(broken)
        line = changed
        try:
            tomllib.loads(line)
        except ValueError:
            continue
        written = " and, in the next line, ".join(line.split("\n"))
        return f"{', and '.join(dict.fromkeys(broken))}; write {written}"
    return ""
