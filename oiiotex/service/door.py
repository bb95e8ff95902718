# SPDX-License-Identifier: Apache-2.0
"""`python -m oiiotex.service.door`: whom a program without our package asks for the resident process.

Its one word is JSON: {"name": "wall.oiiotex?seed=7"}; {"texture": TEXT} for one that was opened before;
{"device": NAME} or {"device": null} for the process alone. It prints {"socket": PATH, "texture": TEXT}, once that
process listens, or {"error": TEXT, "facts": FIELDS}.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from ..errors import Error
from ..session import Session
from .client import connect
from .settings import ResidentSettings
from .texture_file import TextureFile, read_texture_file


def answer(word: str) -> dict[str, Any]:
    """What is printed."""
    try:
        asked = json.loads(word)
        if "device" in asked:
            settings = ResidentSettings.of(Session(device_name=asked["device"]))
            connect(settings).close()
            return {"socket": str(settings.socket())}
        file = TextureFile.of_text(asked["texture"]) if "texture" in asked else read_texture_file(asked["name"])
        settings = file.settings()
        connect(settings).close()
    except Error as error:
        return {"error": str(error), "facts": error.facts()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {"error": "what the door was asked is malformed"}
    return {"socket": str(settings.socket()), "texture": file.text()}


if __name__ == "__main__":
    print(json.dumps(answer(sys.argv[1])))
