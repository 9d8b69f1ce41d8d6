"""Compares answers in words: text contained in a key, and the ways to name an object. Knows no numbers or verdicts."""

import re
from collections.abc import Mapping, Sequence

_WORD = re.compile(r"[^\W_]+(?:[.'’-][^\W_]+)*|_")
_NEGATIONS = frozenset(
    re.findall(
        r"\w+",
        """
        not no non never neither nor none nothing without cannot except unless hardly rather instead false wrong
        incorrect
        """,
    )
)
_EMPTY_WORDS = frozenset(
    re.findall(
        r"\w+",
        """
        a an and any are as at be been both but by can could do does did for from had has have he her his how i if in
        into is it its just may might more most much of off on one only or other our out over same she should so some
        such than that the their them then there these they this those to too under up very was we were what when
        where which while who will with would you your answer object objects body bodies scene yes
        """,
    )
)
_OBJECT_ID = re.compile(r"object_(?P<number>[0-9]{1,6})")
_LEADING_ZEROS = re.compile(r"^(object ?)0+(?=[1-9])")
_OPTION = re.compile(r"(?:(?:case|option) ?#?|#) ?(0|[1-9][0-9]{0,2})", re.IGNORECASE)
_ORDINAL = re.compile(r"(?:the )?([1-9][0-9]{0,2})(st|nd|rd|th)", re.IGNORECASE)
_TWO_NAMES = re.compile(r"(?P<first>[^()]+) \((?P<second>[^()]+)\)")


def words_of(text: str) -> list[str]:
    """The words of a text in lower case, without punctuation; a hyphenated word is one word."""
    return [word for word in _WORD.findall(text.lower()) if word != "_"]


def _negations(words: Sequence[str]) -> int:
    return sum(word in _NEGATIONS or word.startswith("non-") or word.endswith(("n't", "n’t")) for word in words)


def is_contained(answer: str, key: str, options: Sequence[str] = ()) -> bool:
    """Whether the answer's words occur in the key as a contiguous sequence with a content word.

    A content word has letters and is neither a function word nor a negation. Three further rules keep different answers
    apart: every number in the key must be in the answer (`ball` is not `ball 2`); both must have as many negations
    (`oscillates` does not match `no longer oscillates`); and the words must not occur in another of the options.
    """
    said, meant = words_of(answer), words_of(key)
    if not _occurs_in(said, meant) or _negations(said) != _negations(meant):
        return False
    if not any(_is_content(word) for word in said) or {word for word in meant if word[0].isdigit()} - {*said}:
        return False
    other_options = [words for words in map(words_of, options) if words != meant]
    return not any(_occurs_in(said, words) for words in other_options)


def _is_content(word: str) -> bool:
    return len(word) > 1 and word[0].isalpha() and word not in _EMPTY_WORDS and word not in _NEGATIONS


def _occurs_in(said: Sequence[str], meant: Sequence[str]) -> bool:
    return bool(said) and any(
        list(meant[start : start + len(said)]) == list(said) for start in range(len(meant) - len(said) + 1)
    )


def is_object_id(text: str) -> bool:
    """Whether a text is an object id in the form that the prompt asks for, such as `object_2`."""
    return _OBJECT_ID.fullmatch(text) is not None


def named_object(text: str, objects: Mapping[str, str]) -> str | None:
    """Id of the object that a text names; None if it names no object or could mean several.

    Args:
        text: A number (`2`, `#2`), an id (`object_2`, `Object 2`, `object_02`), a public name (`cart_2`), or two of
            these for the same object, the second in brackets.
        objects: Object id → public name.
    """
    folded = _folded(text)
    pair = _TWO_NAMES.fullmatch(folded)
    if pair is not None:
        first, second = named_object(pair["first"], objects), named_object(pair["second"], objects)
        return first if first == second else None
    named = [object_id for object_id, name in objects.items() if folded in _notations(object_id, name)]
    return named[0] if len(named) == 1 else None


def _notations(object_id: str, name: str) -> set[str]:
    folded = _folded(object_id)
    forms = {folded, _folded(name)} - {""}
    numbered = _OBJECT_ID.fullmatch(object_id)
    return forms | {numbered["number"], folded.replace(" ", "")} if numbered else forms


def _folded(text: str) -> str:
    if re.match(r"\s*[-\N{MINUS SIGN}]\s*#?\s*\d", text):
        return text  # a negative number is not an object id
    folded = " ".join(re.split(r"[\s_-]+", text.lower().strip(" _-\t\r\n")))
    return _LEADING_ZEROS.sub(r"\1", re.sub(r"^(object )?# ?(?=[0-9])", r"\1", folded))


def named_option(text: str, options: Sequence[str]) -> str | None:
    """The option that `case 7`, `option 7`, `#7` or `7th` names, by its own name; None if it names none.

    An ordinal names an option only where the options are numbered 1, 2, …: the second of `0, 1, 2` is 1.
    """
    if (found := _OPTION.fullmatch(text)) is not None:
        return found[1]
    found = _ORDINAL.fullmatch(text)
    counted = bool(options) and list(options) == [str(number) for number in range(1, len(options) + 1)]
    if found is None or not counted:
        return None
    number = int(found[1])
    teen = number % 100 in {11, 12, 13}
    return found[1] if found[2].lower() == ("th" if teen else _SUFFIXES.get(number % 10, "th")) else None


_SUFFIXES = {1: "st", 2: "nd", 3: "rd"}
