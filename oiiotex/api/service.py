# SPDX-License-Identifier: Apache-2.0
"""The resident process: client, requests and their priorities, settings."""

from ..service.client import BRUSH, EXPORT, LOOKS, TILES, Client, Request, connect
from ..service.messages import LinkError
from ..service.pictures import image_of, spec_of
from ..service.settings import ResidentSettings, release_folder, reserved_folder
