# SPDX-License-Identifier: Apache-2.0
"""The resident process: client, requests and their priorities, settings."""

from oiiotex.oiiotool.service.client import BRUSH, EXPORT, LOOKS, TILES, Client, Request, connect
from oiiotex.oiiotool.service.messages import LinkError
from oiiotex.oiiotool.service.pictures import image_of, spec_of
from oiiotex.oiiotool.service.settings import ResidentSettings, release_folder, reserved_folder
