"""Writes sparse.safetensors: sparse 3D convolutions as dense ones that are read at the active sites.

Run in the environment of requirements.txt in this folder, from any folder:
    python tests/golden/torch_sparse.py

Axes are [batch, channel, z, y, x]. Cells are rows (sample, z, y, x) in rising order. A kernel is written
as [offset, channel_in, channel_out], offsets in the order z, y, x. All is computed in float64 from float32
inputs.
"""

from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save_file
from torch import Tensor, nn
from torch.nn.functional import conv3d

TENSORS: dict[str, np.ndarray] = {}


def put(name: str, tensor: Tensor) -> None:
    TENSORS[name] = tensor.detach().to(torch.float32).contiguous().numpy()


def random(generator: torch.Generator, *shape: int) -> Tensor:
    """Normal numbers that float32 holds exactly, as float64."""
    return torch.randn(*shape, generator=generator).to(torch.float64)


def random_mask(generator: torch.Generator, shape: tuple[int, ...], share: float) -> Tensor:
    """[batch, 1, z, y, x], true at active sites."""
    return torch.rand(shape[0], 1, *shape[1:], generator=generator) < share


def to_dense(rows: Tensor, mask: Tensor) -> Tensor:
    """[site, channel] -> [batch, channel, z, y, x], zero elsewhere."""
    cells = mask[:, 0].nonzero(as_tuple=True)
    n_batch, _, *shape = mask.shape
    dense = torch.zeros(n_batch, *shape, rows.shape[1], dtype=rows.dtype)
    return dense.index_put(cells, rows).permute(0, 4, 1, 2, 3)


def to_rows(dense: Tensor, mask: Tensor) -> Tensor:
    """[batch, channel, z, y, x] -> [site, channel]."""
    return dense.permute(0, 2, 3, 4, 1)[mask[:, 0]]


def by_offset(kernel: Tensor) -> Tensor:
    """[channel_out, channel_in, z, y, x] -> [offset, channel_in, channel_out]."""
    return kernel.permute(2, 3, 4, 1, 0).flatten(0, 2)


class SparseConv(nn.Module):
    """A convolution whose output is kept at the active sites: those of the input, or all that it reaches."""

    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        kernel: tuple[int, int, int] = (3, 3, 3),
        stride: tuple[int, int, int] = (1, 1, 1),
        padding: tuple[int, int, int] = (1, 1, 1),
    ) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(channels_out, channels_in, *kernel, dtype=torch.float64))
        self.stride, self.padding = stride, padding

    def forward(self, rows: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        out_mask = mask
        if self.stride != (1, 1, 1):
            ones = torch.ones(1, 1, *self.weight.shape[2:], dtype=torch.float64)
            out_mask = conv3d(mask.double(), ones, stride=self.stride, padding=self.padding) > 0.5
        dense = conv3d(to_dense(rows, mask), self.weight, stride=self.stride, padding=self.padding)
        return to_rows(dense, out_mask), out_mask


def write_conv(seed: int, name: str, shape: tuple[int, ...], share: float, conv: SparseConv) -> None:
    generator = torch.Generator().manual_seed(seed)
    conv.weight.data = random(generator, *conv.weight.shape)
    mask = random_mask(generator, shape, share)
    x = random(generator, int(mask.sum()), conv.weight.shape[1]).requires_grad_()
    y, out_mask = conv(x, mask)
    dy = random(generator, *y.shape)
    (y * dy).sum().backward()
    put(f"{name}.shape", torch.tensor(mask.shape[2:]))
    put(f"{name}.cells", mask[:, 0].nonzero())
    put(f"{name}.out_shape", torch.tensor(out_mask.shape[2:]))
    put(f"{name}.out_cells", out_mask[:, 0].nonzero())
    put(f"{name}.w", by_offset(conv.weight))
    put(f"{name}.dw", by_offset(conv.weight.grad))
    for part, tensor in {"x": x, "y": y, "dy": dy, "dx": x.grad}.items():
        put(f"{name}.{part}", tensor)


class ConvNorm(nn.Module):
    """Convolution, then batch norm over the active sites."""

    def __init__(self, *args: object) -> None:
        super().__init__()
        self.conv = SparseConv(*args)
        self.norm = nn.BatchNorm1d(self.conv.weight.shape[0], eps=1e-3, momentum=0.01, dtype=torch.float64)

    def forward(self, rows: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        rows, mask = self.conv(rows, mask)
        return self.norm(rows), mask


class Block(nn.Module):
    """Two convolutions with a short cut around them."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first, self.second = ConvNorm(channels, channels), ConvNorm(channels, channels)

    def forward(self, rows: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        hidden = self.first(rows, mask)[0].relu()
        return (self.second(hidden, mask)[0] + rows).relu(), mask


class Encoder(nn.Module):
    """The published encoder with other channels and blocks."""

    def __init__(
        self, channels_in: int, channels: list[int], blocks: list[int], z_padding: list[int], out: int
    ) -> None:
        super().__init__()
        self.first = ConvNorm(channels_in, channels[0])
        self.stages = nn.ModuleList(
            nn.ModuleList(Block(n) for _ in range(count)) for n, count in zip(channels, blocks, strict=True)
        )
        self.downs = nn.ModuleList(
            ConvNorm(a, b, (3, 3, 3), (2, 2, 2), (z, 1, 1))
            for a, b, z in zip(channels[:-1], channels[1:], z_padding, strict=True)
        )
        self.last = ConvNorm(channels[-1], out, (3, 1, 1), (2, 1, 1), (0, 0, 0))

    def forward(self, rows: Tensor, mask: Tensor) -> Tensor:
        rows, mask = self.first(rows, mask)
        rows = rows.relu()
        for level, blocks in enumerate(self.stages):
            for block in blocks:
                rows, mask = block(rows, mask)
            if level < len(self.downs):
                rows, mask = self.downs[level](rows, mask)
                rows = rows.relu()
        rows, mask = self.last(rows, mask)
        # Channel and height make the channels of the map, channel outermost.
        return to_dense(rows.relu(), mask).flatten(1, 2)


def write_encoder(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    net = Encoder(4, channels=[3, 4, 5], blocks=[1, 2, 1], z_padding=[1, 0], out=6)
    for name, parameter in net.named_parameters():
        scale = 1.0 if "norm" in name else (2 / (27 * parameter.shape[1])) ** 0.5
        shift = 1.0 if name.endswith("norm.weight") else 0.0
        spread = random(generator, *parameter.shape) * (0.3 if "norm" in name else 2.0 * scale) + shift
        parameter.data = spread.to(torch.float32).to(torch.float64)
    for name, buffer in net.named_buffers():
        if name.endswith("running_mean"):
            buffer.copy_(random(generator, *buffer.shape) * 0.5)
        elif name.endswith("running_var"):
            buffer.copy_(random(generator, *buffer.shape).abs() + 0.5)
        buffer.data = buffer.to(torch.float32).to(torch.float64) if buffer.is_floating_point() else buffer

    for name, tensor in net.state_dict().items():
        if not name.endswith("num_batches_tracked"):
            is_kernel = tensor.ndim == 5
            put(f"encoder.net.{name.replace('conv.', '')}", by_offset(tensor) if is_kernel else tensor)

    mask = random_mask(generator, (2, 21, 16, 12), 0.04)
    x = random(generator, int(mask.sum()), 4).requires_grad_()
    with torch.no_grad():
        put("encoder.y_eval", net.eval()(x, mask))
    y = net.train()(x, mask)
    dy = random(generator, *y.shape)
    (y * dy).sum().backward()
    put("encoder.shape", torch.tensor(mask.shape[2:]))
    put("encoder.cells", mask[:, 0].nonzero())
    put("encoder.x", x)
    put("encoder.dx", x.grad)
    put("encoder.y_train", y)
    put("encoder.dy", dy)
    put("encoder.d_first", by_offset(net.first.conv.weight.grad))
    put("encoder.d_last", by_offset(net.last.conv.weight.grad))
    put("encoder.running_mean", net.last.norm.running_mean)
    put("encoder.running_var", net.last.norm.running_var)


def main() -> None:
    halve = ((3, 3, 3), (2, 2, 2))
    write_conv(1, "submanifold", (2, 5, 9, 8), 0.15, SparseConv(3, 5))
    write_conv(2, "submanifold_wide", (1, 6, 7, 9), 0.3, SparseConv(24, 17))
    write_conv(3, "strided", (2, 7, 10, 9), 0.1, SparseConv(5, 7, *halve, (1, 1, 1)))
    write_conv(4, "strided_flat", (2, 11, 8, 7), 0.08, SparseConv(16, 4, *halve, (0, 1, 1)))
    write_conv(5, "column", (2, 5, 7, 6), 0.2, SparseConv(8, 6, (3, 1, 1), (2, 1, 1), (0, 0, 0)))
    write_encoder(6)
    save_file(TENSORS, Path(__file__).parent / "sparse.safetensors")


if __name__ == "__main__":
    main()
