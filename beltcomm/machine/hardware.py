"""Identity of drives, and what this computer remembers of them: in the user's state folder, one small file each."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.drive import Capabilities
from beltcomm.errors import UsageError

#: What of an identity tells one drive from others.
TELLING = ("vendor_id", "product_code", "serial_number", "device_name")
#: How what a drive of this package says of its hardware (1009h) begins: nothing moves behind it.
VIRTUAL = "virtual"


def state_folder() -> Path:
    """Folder in which beltcomm remembers drives: ``$XDG_STATE_HOME/beltcomm`` or the system's own."""
    return Path(platformdirs.user_state_path("beltcomm"))


@dataclass(frozen=True)
class Hardware:
    """A connected drive as one that is met again.

    Attributes
    ----------
    name : str
        As in ``--drive``.
    identity : Mapping[str, str]
        Of its capabilities.
    """

    name: str
    identity: Mapping[str, str]

    @classmethod
    def of(cls, name: str, capabilities: Capabilities) -> Hardware:
        """The drive behind ``capabilities``.

        Parameters
        ----------
        name : str
            Of the drive's profile.
        capabilities : Capabilities
        """
        return cls(name, dict(capabilities.identity))

    @property
    def serial(self) -> str:
        """Serial number (1018h:4), "" when the drive tells none: 0 means that."""
        serial = self.identity.get("serial_number", "")
        return "" if serial == "0" else serial

    @property
    def virtual(self) -> bool:
        """True for a simulated drive, in this process or in another one."""
        return self.identity.get("hardware", "").startswith(VIRTUAL)

    @property
    def forgetful(self) -> bool:
        """True if it begins anew with every command: the virtual drive inside this process, which names its plant."""
        return "plant" in self.identity

    @property
    def unique(self) -> bool:
        """True if its serial number tells it from every other drive."""
        return bool(self.serial) and not self.virtual

    @property
    def words(self) -> str:
        """For messages: ``CMMP-AS, vendor 29, product 0, serial number 4711``."""
        told = [f"vendor {self.identity.get('vendor_id', 'unknown')}", f"product {self.identity.get('product_code', 'unknown')}"]
        serial = f"serial number {self.serial}" if self.serial else "no serial number"
        return ", ".join([self.identity.get("device_name") or "a drive without a name", *told, serial])

    @property
    def confirmation(self) -> str:
        """Word that ``--first-motion-confirmed`` must name: the serial number, else the device's name, else vendor:product."""
        numbers = f"{self.identity.get('vendor_id', '')}:{self.identity.get('product_code', '')}"
        return self.serial or self.identity.get("device_name") or numbers

    def named_by(self, word: str) -> bool:
        """True if a word names this drive; ``vendor:product:serial`` does too."""
        long = ":".join(self.identity.get(key, "") for key in TELLING[:3])
        return word.strip() in (self.confirmation, long)

    @property
    def key(self) -> str:
        """File name of what is remembered of it; a drive without a serial number is met again at its own place only."""
        telling = [self.identity.get(key, "") for key in TELLING]
        if not self.unique:
            telling.append(self.name)
        plain = re.sub(r"[^A-Za-z0-9]+", "-", " ".join(filter(None, telling))).strip("-")[:60]
        return f"{plain}-{hashlib.sha256(repr(telling).encode()).hexdigest()[:8]}"

    def remembered(self) -> dict[str, Any]:
        """Notes remembered of it; empty when there are none, or none that can be read."""
        path = self._file
        try:
            return read_yaml(path) if path.is_file() else {}
        except (OSError, UsageError):
            return {}

    def remember(self, **entries: Any) -> bool:
        """Add to what is remembered.

        Parameters
        ----------
        **entries : Any
            Anything that YAML can hold.

        Returns
        -------
        bool
            False when the folder cannot be written.
        """
        path = self._file
        known = {"drive": {key: self.identity.get(key, "") for key in TELLING}, "name": self.name}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, to_yaml({**self.remembered(), **known, **entries}))
        except (OSError, UsageError):
            return False
        return True

    @property
    def _file(self) -> Path:
        return state_folder() / "drives" / f"{self.key}.yaml"
