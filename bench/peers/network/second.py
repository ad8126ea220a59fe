"""SECOND (the public configuration on KITTI) in PyTorch and spconv, its modules named as in OpenPCDet's checkpoints.

Voxels -> sparse 3-D convolutions -> bird's-eye map -> two blocks -> two ups, concatenated -> 1x1 heads. Used as a peer in
time, and as an outside answer for `mluc-lab import`.
"""

import numpy as np
import spconv.pytorch as spconv
import torch
from torch import nn

RANGE_MIN_M = np.array([0.0, -40.0, -3.0], np.float32)
VOXEL_M = np.array([0.05, 0.05, 0.1], np.float32)
CELLS_XYZ = (1408, 1600, 40)
POINTS_PER_VOXEL = 5
VOXELS_MAX = 40_000
EPS = 1e-3


def voxelize(points):
    """Mean of at most five points a voxel, file order; (voxels, 4) and (voxels, 3) in z, y, x."""
    cells = np.floor((points[:, :3] - RANGE_MIN_M) / VOXEL_M)
    inside = ((cells >= 0) & (cells < CELLS_XYZ)).all(axis=1)
    points, cells = points[inside], cells[inside].astype(np.int64)
    flat = (cells[:, 2] * CELLS_XYZ[1] + cells[:, 1]) * CELLS_XYZ[0] + cells[:, 0]
    _, first, voxel = np.unique(flat, return_index=True, return_inverse=True)
    # Voxels in the order in which the file opens them.
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    voxel, first = rank[voxel], first[order]
    kept_voxels = min(len(first), VOXELS_MAX)
    by_voxel = np.argsort(voxel, kind="stable")
    starts = np.searchsorted(voxel[by_voxel], np.arange(len(first)))
    place = np.arange(len(voxel)) - starts[voxel[by_voxel]]
    use = by_voxel[(place < POINTS_PER_VOXEL) & (voxel[by_voxel] < kept_voxels)]
    sums = np.zeros((kept_voxels, 4), np.float32)
    np.add.at(sums, voxel[use], points[use])
    counts = np.bincount(voxel[use], minlength=kept_voxels).astype(np.float32)
    sites = cells[first[:kept_voxels]][:, ::-1].astype(np.int32)
    return sums / counts[:, None], np.ascontiguousarray(sites)


def unit(convolution, channels):
    return spconv.SparseSequential(convolution, nn.BatchNorm1d(channels, eps=EPS), nn.ReLU())


def submanifold(cin, cout, key):
    return unit(spconv.SubMConv3d(cin, cout, 3, padding=1, bias=False, indice_key=key), cout)


def strided(cin, cout, padding, kernel=3, stride=2):
    layer = spconv.SparseConv3d(cin, cout, kernel, stride=stride, padding=padding, bias=False)
    return unit(layer, cout)


class Backbone3d(nn.Module):
    def __init__(self):
        super().__init__()
        stage = spconv.SparseSequential
        self.conv_input = submanifold(4, 16, "subm1")
        self.conv1 = stage(submanifold(16, 16, "subm1"))
        self.conv2 = self.stage(16, 32, 1, "subm2")
        self.conv3 = self.stage(32, 64, 1, "subm3")
        self.conv4 = self.stage(64, 64, (0, 1, 1), "subm4")
        self.conv_out = strided(64, 128, 0, kernel=(3, 1, 1), stride=(2, 1, 1))

    @staticmethod
    def stage(cin, cout, padding, key):
        layers = [strided(cin, cout, padding)] + [submanifold(cout, cout, key) for _ in range(2)]
        return spconv.SparseSequential(*layers)

    def forward(self, features, sites):
        batch = torch.zeros((len(sites), 1), dtype=torch.int32)
        x, y, z = CELLS_XYZ
        sparse = spconv.SparseConvTensor(features, torch.cat([batch, sites], 1), [z + 1, y, x], 1)
        for part in (self.conv_input, self.conv1, self.conv2, self.conv3, self.conv4):
            sparse = part(sparse)
        return self.conv_out(sparse)


def to_map(sparse):
    """Bird's-eye map: channel * depth + z."""
    dense = sparse.dense()
    batch, channels, depth, rows, columns = dense.shape
    return dense.reshape(batch, channels * depth, rows, columns)


def block(cin, cout, stride):
    layers = [nn.ZeroPad2d(1), nn.Conv2d(cin, cout, 3, stride=stride, bias=False)]
    layers += [nn.BatchNorm2d(cout, eps=EPS), nn.ReLU()]
    for _ in range(5):
        layers += [nn.Conv2d(cout, cout, 3, padding=1, bias=False)]
        layers += [nn.BatchNorm2d(cout, eps=EPS), nn.ReLU()]
    return nn.Sequential(*layers)


def up(cin, cout, factor):
    layer = nn.ConvTranspose2d(cin, cout, factor, stride=factor, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(cout, eps=EPS), nn.ReLU())


class Backbone2d(nn.Module):
    def __init__(self):
        super().__init__()
        self.blocks = nn.ModuleList([block(256, 128, 1), block(128, 256, 2)])
        self.deblocks = nn.ModuleList([up(128, 256, 1), up(256, 256, 2)])

    def forward(self, bev):
        first = self.blocks[0](bev)
        second = self.blocks[1](first)
        return torch.cat([self.deblocks[0](first), self.deblocks[1](second)], dim=1)


class DenseHead(nn.Module):
    def __init__(self, classes=3):
        super().__init__()
        anchors = 2 * classes
        self.conv_cls = nn.Conv2d(512, anchors * classes, 1)
        self.conv_box = nn.Conv2d(512, anchors * 7, 1)
        self.conv_dir_cls = nn.Conv2d(512, anchors * 2, 1)

    def forward(self, features):
        return self.conv_cls(features), self.conv_box(features), self.conv_dir_cls(features)


class Second(nn.Module):
    def __init__(self):
        super().__init__()
        self.register_buffer("global_step", torch.zeros(1, dtype=torch.long))
        self.backbone_3d = Backbone3d()
        self.backbone_2d = Backbone2d()
        self.dense_head = DenseHead()


def random_second(seed=1):
    """Weights at random that keep the size of the signal, batch norms that are not the identity."""
    torch.manual_seed(seed)
    model = Second().eval()
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            if parameter.dim() == 5:  # (out, z, y, x, in)
                fan_in = parameter[0].numel()
            elif parameter.dim() == 4:
                transposed = "deblocks" in name
                fan_in = parameter.shape[0] if transposed else parameter[0].numel()
            else:
                parameter.uniform_(0.8, 1.2) if name.endswith("weight") else parameter.uniform_(-0.1, 0.1)
                continue
            parameter.uniform_(-1, 1).mul_((6 / fan_in) ** 0.5)
        for name, buffer in model.named_buffers():
            if name.endswith("running_mean"):
                buffer.uniform_(-0.1, 0.1)
            elif name.endswith("running_var"):
                buffer.uniform_(0.5, 1.5)
        # An empty scene is to be empty.
        model.dense_head.conv_cls.bias.fill_(-12.0)
    return model


def fused_2d(model):
    """The bird's-eye part with every batch norm folded into its convolution: what a careful user runs."""
    from torch.nn.utils.fusion import fuse_conv_bn_eval

    def fuse(layers):
        fused, layers = [], list(layers)
        for place, layer in enumerate(layers):
            if isinstance(layer, nn.BatchNorm2d):
                transposed = isinstance(fused[-1], nn.ConvTranspose2d)
                fused[-1] = fuse_conv_bn_eval(fused[-1], layer, transpose=transposed)
            elif not isinstance(layer, nn.ZeroPad2d):
                fused.append(layer)
        if isinstance(layers[0], nn.ZeroPad2d):
            fused[0].padding = (1, 1)
        return nn.Sequential(*fused)

    source = model.backbone_2d
    part = Backbone2d()
    part.blocks = nn.ModuleList([fuse(layers) for layers in source.blocks])
    part.deblocks = nn.ModuleList([fuse(layers) for layers in source.deblocks])
    return part.eval()
