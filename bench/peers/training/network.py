"""The step that `train_step --write DIR` left, in PyTorch: same weights, same rulebooks, same gradient of the outputs.

Sparse layers: gather, multiply, scatter tap by tap with the rulebook's lists made beforehand, and the centre tap of a
submanifold layer as one product without lists. The backward pass is written out, as libraries do: autograd would fill a
map of zeros for each tap. (spconv 2.3.8 gathers and scatters the same way on a processor, but its backward pass asks for a CUDA stream.)
Bird's-eye layers: stock, channels_last, the heads as one convolution.
"""

import json
import time
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

ABSENT = 2**32 - 1


def add_rows(to, places, rows):
    """The fastest of PyTorch's ways here: index_add_, index_copy_ of sums, and one product over all taps take longer."""
    to.scatter_add_(0, places[:, None].expand_as(rows), rows)


class SparseConvolution(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x, weight, taps, outputs):
        ctx.save_for_backward(x, weight)
        ctx.taps = taps
        y = None
        for tap, sources, targets in taps:
            if sources is None:
                y = x @ weight[tap]
                continue
            if y is None:
                y = x.new_zeros(outputs, weight.shape[2])
            add_rows(y, targets, x.index_select(0, sources) @ weight[tap])
        return y

    @staticmethod
    def backward(ctx, gradient):
        x, weight = ctx.saved_tensors
        to_weight = torch.zeros_like(weight)
        to_x = None
        for tap, sources, targets in ctx.taps:
            rows = gradient if sources is None else gradient.index_select(0, targets)
            inputs = x if sources is None else x.index_select(0, sources)
            torch.mm(inputs.T, rows, out=to_weight[tap])
            if ctx.needs_input_grad[0]:
                back = rows @ weight[tap].T
                if sources is None:
                    to_x = back
                    continue
                if to_x is None:
                    to_x = torch.zeros_like(x)
                add_rows(to_x, sources, back)
        return to_x, to_weight, None, None


def lists(gather):
    """(tap, input rows, output rows) of each tap that has any; the tap that reads every row in place comes first."""
    taps = []
    for tap in range(gather.shape[1]):
        targets = np.flatnonzero(gather[:, tap] != ABSENT)
        sources = gather[targets, tap].astype(np.int64)
        if len(sources) == len(gather) and (sources == np.arange(len(gather))).all():
            taps.insert(0, (tap, None, None))
        elif len(sources):
            taps.append((tap, torch.from_numpy(sources), torch.from_numpy(targets)))
    return taps


def now():
    """Milliseconds: on the wall, and that all threads had a processor."""
    return 1e3 * time.perf_counter(), 1e3 * time.process_time()


class Step:
    def __init__(self, folder, bf16):
        self.folder, self.bf16 = Path(folder), bf16
        self.about = json.loads((self.folder / "step.json").read_text())
        self.flat = self.read("parameters")
        self.voxels = torch.from_numpy(self.read("voxels").reshape(-1, 4))
        self.cells = torch.from_numpy(self.read("cells", np.uint32).astype(np.int64))
        self.levels = torch.from_numpy(self.read("levels", np.uint32).astype(np.int64))
        self.parameters = []  # (tensor, from its gradient to the flat list's order, place)
        self.sparse = [self.sparse_layer(number, layer) for number, layer in enumerate(self.about["sparse"])]
        self.block1 = [self.dense_layer(layer) for layer in self.about["block1"]]
        self.block2 = [self.dense_layer(layer) for layer in self.about["block2"]]
        self.up1, self.up2 = self.up(self.about["up1"], 1), self.up(self.about["up2"], 2)
        self.head_weights = [self.head(head) for head in self.about["heads"]]
        self.output_gradient = self.dense_gradient()

    def read(self, name, kind=np.float32):
        return np.fromfile(self.folder / f"{name}.bin", kind)

    def parameter(self, start, shape, to_torch=lambda a: a, to_ours=lambda a: a, nhwc=False):
        values = self.flat[start : start + int(np.prod(shape))].reshape(shape)
        tensor = torch.from_numpy(np.ascontiguousarray(to_torch(values)))
        if nhwc:
            tensor = tensor.contiguous(memory_format=torch.channels_last)
        tensor.requires_grad_(True)
        self.parameters.append((tensor, to_ours, start))
        return tensor

    def norm(self, layer):
        return [self.parameter(layer[key], (layer["channels"],)) for key in ("gamma", "beta")]

    def sparse_layer(self, number, layer):
        gather = self.read(f"gather.{number}", np.uint32).reshape(-1, layer["taps"])
        weight = self.parameter(layer["weight"], (layer["taps"], layer["cin"], layer["cout"]))
        return weight, lists(gather), len(gather), self.norm(layer)

    def dense_layer(self, layer):
        weight = self.parameter(
            layer["weight"],
            (3, 3, layer["cin"], layer["cout"]),
            lambda w: w.transpose(3, 2, 0, 1),
            lambda g: g.transpose(2, 3, 1, 0),
            nhwc=True,
        )
        return weight, layer["stride"], self.norm(layer)

    def up(self, layer, factor):
        # Columns of the weights: cell (y, x) of factor x factor, then channel.
        weight = self.parameter(
            layer["weight"],
            (layer["cin"], factor, factor, layer["channels"]),
            lambda w: w.transpose(0, 3, 1, 2),
            lambda g: g.transpose(0, 2, 3, 1),
            nhwc=True,
        )
        return weight, factor, self.norm(layer)

    def head(self, head):
        shape = (head["cin"], head["cout"])
        weight = self.parameter(head["weight"], shape, np.transpose, np.transpose)
        return weight, self.parameter(head["bias"], shape[1:])

    def dense_gradient(self):
        """Of every head at every cell: 0 where the trainer does not look."""
        frames, rows, columns = self.about["shape"]
        widths = [head["cout"] for head in self.about["heads"]]
        gradient = np.zeros((frames * rows * columns, sum(widths)), np.float32)
        gradient[:, : widths[0]] = self.read("presence_gradient").reshape(-1, widths[0])
        labelled = self.read("labelled", np.uint32)
        gradient[labelled, widths[0] :] = self.read("labelled_gradient").reshape(len(labelled), -1)
        return torch.from_numpy(gradient).view(frames, rows, columns, -1).permute(0, 3, 1, 2)

    def normalise(self, x, norm):
        x = F.batch_norm(x, None, None, *norm, training=True, eps=self.about["epsilon"])
        return F.relu(x, inplace=True)

    def sparse_forward(self):
        rows = self.voxels
        for weight, taps, outputs, norm in self.sparse:
            rows = self.normalise(SparseConvolution.apply(rows, weight, taps, outputs), norm)
        frames, height, width = self.about["shape"]
        channels = rows.shape[1]
        bev = rows.new_zeros(frames * height * width, channels, self.about["map_channels"] // channels)
        # Each cell and level has one row at most.
        bev = bev.transpose(1, 2).index_put((self.cells, self.levels), rows).transpose(1, 2)
        return bev.view(frames, height, width, -1).permute(0, 3, 1, 2)

    def block(self, x, layers):
        for weight, stride, norm in layers:
            x = self.normalise(F.conv2d(x, weight, stride=stride, padding=1), norm)
        return x

    def map_forward(self, bev):
        with torch.autocast("cpu", torch.bfloat16, enabled=self.bf16):
            first = self.block(bev, self.block1)
            second = self.block(first, self.block2)
            ups = [
                self.normalise(F.conv_transpose2d(x, weight, stride=factor), norm)
                for x, (weight, factor, norm) in ((first, self.up1), (second, self.up2))
            ]
            weights = torch.cat([weight for weight, _ in self.head_weights])[:, :, None, None]
            biases = torch.cat([bias for _, bias in self.head_weights])
            return F.conv2d(torch.cat(ups, 1), weights, biases)

    def run(self):
        """One step: its output, and milliseconds of its parts."""
        for tensor, _, _ in self.parameters:
            tensor.grad = None
        clock = [now()]
        bev = self.sparse_forward()
        clock.append(now())
        # Cut here, so that the parts' backward passes can be told apart.
        leaf = bev.detach().requires_grad_(True)
        output = self.map_forward(leaf)
        clock.append(now())
        output.backward(self.output_gradient.to(output.dtype))
        clock.append(now())
        bev.backward(leaf.grad)
        clock.append(now())
        names = ("sparse_forward", "map_forward", "map_backward", "sparse_backward")
        laps = [{"wall": b[0] - a[0], "cpu": b[1] - a[1]} for a, b in zip(clock, clock[1:])]
        return output, dict(zip(names, laps))

    def check(self):
        """Ours and PyTorch's f32 against PyTorch in double precision: outputs by their largest, gradients by a tensor's norm.

        A gradient at random meets every unit whose sign rounding has turned: a share of 1e-4 of them is 1 % of a norm.
        """
        answers = {"pytorch": self.answers(), "mluc": (*self.our_outputs(), *self.our_gradients())}
        with torch.no_grad():
            for tensor, _, _ in self.parameters:
                tensor.data, tensor.grad = tensor.double(), None
        self.voxels, self.output_gradient = self.voxels.double(), self.output_gradient.double()
        exact = self.answers()
        report = {}
        for name, found in answers.items():
            outputs = max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found[:2], exact[:2]))
            norm = np.linalg.norm
            gradients = max(float(norm(a - b) / norm(b)) for a, b in zip(found[2:], exact[2:]))
            report[name] = {"outputs": outputs, "gradients": gradients}
        return report

    def answers(self):
        """Presence of every cell, other heads of labelled cells, every parameter's gradient, laid out as ours."""
        output, _ = self.run()
        rows = output.detach().permute(0, 2, 3, 1).reshape(-1, output.shape[1]).numpy()
        width = self.about["heads"][0]["cout"]
        others = rows[self.read("labelled", np.uint32), width:]
        gradients = [to_ours(tensor.grad.numpy()).ravel() for tensor, to_ours, _ in self.parameters]
        return rows[:, :width], others, *gradients

    def our_outputs(self):
        width = self.about["heads"][0]["cout"]
        labelled = len(self.read("labelled", np.uint32))
        return self.read("presence").reshape(-1, width), self.read("labelled_outputs").reshape(labelled, -1)

    def our_gradients(self):
        flat = self.read("gradients")
        return [flat[start : start + tensor.numel()] for tensor, _, start in self.parameters]
