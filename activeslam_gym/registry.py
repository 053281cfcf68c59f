"""Registries: the estimators, sensors and other parts that a scenario chooses by name."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

Entry = TypeVar("Entry")


class Registry(Generic[Entry]):
    """Named entries of one ``kind``, such as "estimator"; `register` adds one at run time."""

    def __init__(self, kind: str, entries: dict[str, Entry] | None = None) -> None:
        self.kind = kind
        self._entries: dict[str, Entry] = dict(entries or {})

    def register(self, name: str) -> Callable[[Any], Any]:
        """Decorator that adds an entry, or replaces the one of that name.

        Raises:
            ValueError: ``name`` is not a string, or empty.
        """
        if not isinstance(name, str) or not name:
            raise ValueError(f"the name of a registered {self.kind} must be a string, got {name!r}")

        def enter(entry: Any) -> Any:
            self._entries[name] = entry
            return entry

        return enter

    def __getitem__(self, name: Any) -> Entry:
        """The entry of that name.

        Raises:
            ValueError: there is none; the message lists those that there are.
        """
        if not isinstance(name, str) or name not in self._entries:
            raise ValueError(f"{self.kind} must be one of {', '.join(self._entries)}, got {name!r}")
        return self._entries[name]

    def __contains__(self, name: object) -> bool:
        return name in self._entries
