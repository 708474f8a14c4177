"""Writes bev_backbone.safetensors: SECOND and its FPN, small, with both ways of bringing scales to one size.

Run in the environment of requirements.txt in this folder, from any folder:
    python tests/golden/torch_bev_backbone.py

All is computed in float64 from float32 inputs.
"""

from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor, nn

CHANNELS_IN, CHANNELS, STRIDES, LAYERS, CHANNELS_OUT = 5, [4, 6, 5], [1, 2, 2], [1, 2, 0], [3, 4, 2]


def norm(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


class ConvBlock(nn.Module):
    """3x3 convolution, batch norm, ReLU."""

    def __init__(self, channels_in: int, channels_out: int, stride: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(channels_in, channels_out, 3, stride, 1, bias=False)
        self.norm = norm(channels_out)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm(self.conv(x)).relu()


class Neck(nn.Module):
    """A scale brought to the size of the first: 1x1 or transposed convolution, batch norm, ReLU."""

    def __init__(self, channels_in: int, channels_out: int, factor: int, is_transposed: bool) -> None:
        super().__init__()
        if factor > 1 and is_transposed:
            self.spread = nn.ConvTranspose2d(channels_in, channels_out, factor, factor, bias=False)
        else:
            self.point = nn.Conv2d(channels_in, channels_out, 1, bias=False)
        self.norm, self.factor = norm(channels_out), factor

    def forward(self, x: Tensor) -> Tensor:
        if hasattr(self, "spread"):
            return self.norm(self.spread(x)).relu()
        x = self.norm(self.point(x)).relu()
        return x.repeat_interleave(self.factor, 2).repeat_interleave(self.factor, 3)


class BevBackbone(nn.Module):
    """Scales of 3x3 convolutions, their necks side by side in the channels."""

    def __init__(self, is_transposed: bool) -> None:
        super().__init__()
        self.scales, self.necks = nn.ModuleList(), nn.ModuleList()
        before, factor = CHANNELS_IN, 1
        for level, channels in enumerate(CHANNELS):
            blocks = [ConvBlock(before, channels, STRIDES[level])]
            blocks += [ConvBlock(channels, channels, 1) for _ in range(LAYERS[level])]
            self.scales.append(nn.ModuleList(blocks))
            factor *= STRIDES[level] if level > 0 else 1
            self.necks.append(Neck(channels, CHANNELS_OUT[level], factor, is_transposed))
            before = channels

    def forward(self, x: Tensor) -> Tensor:
        outputs = []
        for blocks, neck in zip(self.scales, self.necks, strict=True):
            for block in blocks:
                x = block(x)
            outputs.append(neck(x))
        return torch.cat(outputs, 1)


def case(name: str, seed: int, is_transposed: bool) -> dict[str, Tensor]:
    torch.manual_seed(seed)
    net = BevBackbone(is_transposed)
    for key, tensor in net.state_dict().items():
        if key.endswith(("norm.weight", "running_var")):
            tensor.uniform_(0.5, 1.5)
        elif key.endswith(("norm.bias", "running_mean")):
            tensor.normal_(0, 0.3)
    tensors = {f"net.{key}": t.clone() for key, t in net.state_dict().items() if "tracked" not in key}
    x, net = torch.randn(2, CHANNELS_IN, 8, 12), net.double()
    tensors["x"] = x
    with torch.no_grad():
        tensors["y_eval"] = net.eval()(x.double())
    x = x.double().requires_grad_()
    y = net.train()(x)
    dy = torch.randn(*y.shape)
    (y * dy).sum().backward()
    neck = net.necks[2]
    d_neck = (neck.spread if is_transposed else neck.point).weight.grad
    tensors |= {"y_train": y, "dy": dy, "dx": x.grad, "d_neck": d_neck}
    return {f"{name}.{key}": t.detach().float().contiguous() for key, t in tensors.items()}


def main() -> None:
    tensors = case("transpose", 1, True) | case("nearest", 2, False)
    save_file(tensors, Path(__file__).parent / "bev_backbone.safetensors")


if __name__ == "__main__":
    main()
