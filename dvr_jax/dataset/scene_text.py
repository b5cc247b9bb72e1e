"""The text of a scene as a template and numbers, because decimal digits take more room than the numbers themselves.

The scenes of one sweep differ in their numbers alone. The template is the JSON text with a `#` in the place of each
decimal number. It is the same text in nearly all scenes of a shard, so only the numbers take room: 8 bytes each.
"""

import re
from dataclasses import dataclass

import msgspec

_PLACE = "#"
_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class SceneText:
    """The JSON text of a scene, taken apart."""

    template: str
    """The text with `#` for each number; where `numbers` is empty, the text itself."""

    numbers: tuple[float, ...]
    """The numbers in the order of their places."""

    @classmethod
    def take_apart(cls, text: str) -> "SceneText":
        """Take the numbers out of a text.

        A text that could not be put together again stays whole, for instance where an object has a name with `#`.
        """
        numbers = tuple(map(float, _NUMBER.findall(text)))
        apart = cls(_NUMBER.sub(_PLACE, text), numbers)
        is_lossless = text.count(_PLACE) == 0 and apart.put_together() == text
        return apart if is_lossless else cls(text, ())

    def put_together(self) -> str:
        """Return the text with its numbers.

        Raises:
            ValueError: the template has another number of places than there are numbers.
        """
        if not self.numbers:
            return self.template

        pieces = self.template.split(_PLACE)
        if len(pieces) != len(self.numbers) + 1:
            raise ValueError(
                f"a scene has {len(self.numbers)} numbers for {len(pieces) - 1} places"
            )
        text = pieces[0]
        for number, piece in zip(self.numbers, pieces[1:], strict=True):
            text += msgspec.json.encode(number).decode() + piece
        return text
