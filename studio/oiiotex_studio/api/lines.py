# SPDX-License-Identifier: Apache-2.0
"""Command lines: parsing, dry runs, and execution here or in worker processes."""

from oiiotex.engine.core.parameters import nearest
from oiiotex.engine.machine import forget_current_folder, memory, usable_threads
from oiiotex.engine.run import as_provisional
from oiiotex.oiiotool.cli.language.parse import Step, parse, split_modifiers
from oiiotex.oiiotool.cli.language.sequences import Frame
from oiiotex.oiiotool.cli.main import exit_with
from oiiotex.oiiotool.cli.running.parallel import WorkerDied, worker_processes
from oiiotex.oiiotool.cli.running.progress import Display
from oiiotex.oiiotool.cli.running.tasks import Job, Task, session_for, work
from oiiotex.oiiotool.cli.stack.rehearsal import Rehearsals
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
