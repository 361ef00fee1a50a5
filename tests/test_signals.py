"""A signal while LLVM is at work: what is raised in a function that it calls would be dropped."""

import subprocess
import sys

from wrenchgap._safe_path import environment

COMPILES = """
import os, signal, time
from wrenchgap import _signals
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it may be ignored
_signals.catch()
import llvmlite.binding as llvm
llvm.initialize_native_target()
llvm.initialize_native_asmprinter()
machine = llvm.Target.from_default_triple().create_target_machine()
engine = llvm.create_mcjit_compiler(llvm.parse_assembly("define i32 @seven() { ret i32 7 }"), machine)
answered = []
def object_code(module):
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
    answered.append(module.name)
engine.set_object_cache(getbuffer_func=object_code)
try:
    engine.finalize_object()
    time.sleep(4.0)
except KeyboardInterrupt as error:
    print(len(answered), error.code, flush=True)
os._exit(0)
"""


def test_what_llvm_asks_for_is_answered_before_the_command_ends():
    command = [sys.executable, "-c", COMPILES]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.split() == ["1", "130"], done.stderr
    assert "ignored" not in done.stderr
