# SPDX-License-Identifier: Apache-2.0
"""Command lines: parsing, dry runs, and execution here or in worker processes."""

from ..cli.language.parse import Step, parse, split_modifiers
from ..cli.language.sequences import Frame
from ..cli.main import exit_with
from ..cli.running.parallel import WorkerDied, worker_processes
from ..cli.running.progress import Display
from ..cli.running.tasks import Job, Task, session_for, work
from ..cli.stack.rehearsal import Rehearsals
from ..cli.vocabulary import LANGUAGE
from ..core.parameters import nearest
from ..machine import forget_current_folder, memory, usable_threads
from ..run import as_foreseen
