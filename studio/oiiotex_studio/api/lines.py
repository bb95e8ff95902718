# SPDX-License-Identifier: Apache-2.0
"""Command lines: parsing, dry runs, execution here or in worker processes; options that a distribution adds."""

from oiiotex.engine.core.access import InBands, Whole
from oiiotex.engine.core.parameters import nearest, param
from oiiotex.engine.machine import forget_current_folder, memory, program, start, start_python, usable_threads
from oiiotex.engine.opencl.device_choice import choose as require_device
from oiiotex.engine.run import as_provisional
from oiiotex.oiiotool.cli.language.parse import CommandLine, Option, Step, parse, split_modifiers
from oiiotex.oiiotool.cli.language.sequences import Frame, frame_numbers
from oiiotex.oiiotool.cli.main import exit_with
from oiiotex.oiiotool.cli.running.frame_runs import tell_runner
from oiiotex.oiiotool.cli.running.parallel import WorkerDied, worker_processes
from oiiotex.oiiotool.cli.running.progress import Display
from oiiotex.oiiotool.cli.running.shares import Shares, line_of
from oiiotex.oiiotool.cli.running.tasks import Job, Task, run_task, session_for, skip, work
from oiiotex.oiiotool.cli.stack.chain import Chain
from oiiotex.oiiotool.cli.stack.rehearsal import Rehearsals
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
