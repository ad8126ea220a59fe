"""PyTorch in a process of its own: reads a line `FOLDER COUNT`, answers with a step's milliseconds by part, COUNT of them.

    worker.py f32|bf16|check THREADS

FOLDER is what `train_step --write` left. bf16: the bird's-eye part under torch.autocast. check: how far ours and
PyTorch's f32 are from double precision.
"""

import json
import os
import sys

KIND, THREADS = sys.argv[1], int(sys.argv[2])
os.environ["OMP_NUM_THREADS"] = str(THREADS)
# Threads that wait sleep: spinning would count as work, and beside other programs it would take their time and ours.
os.environ["OMP_WAIT_POLICY"] = "passive"
os.environ["GOMP_SPINCOUNT"] = "0"

import torch

from network import Step

torch.set_num_threads(THREADS)


def main():
    torch.manual_seed(1)
    steps = {}
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        folder, count = line.rsplit(" ", 1)
        if folder not in steps:
            steps = {folder: Step(folder, KIND == "bf16")}
            if KIND != "check":
                steps[folder].run()  # not timed
        step = steps[folder]
        answer = step.check() if KIND == "check" else [step.run()[1] for _ in range(int(count))]
        print(json.dumps(answer), flush=True)


main()
