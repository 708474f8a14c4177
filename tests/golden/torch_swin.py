"""Writes swin.safetensors (a small Swin Transformer with gradients), swin_t.safetensors (some outputs of
Swin-T) and swin_weights_* (the small one's weights under the key names of four libraries).

    .venv-golden/bin/python tests/golden/torch_swin.py

The net is written from the paper (Liu et al. 2021) and the published configs' values; its state dict has
harmzone's names.
"""

from pathlib import Path

import formula
import torch
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional as F  # noqa: N812

HERE = Path(__file__).parent


class Attention(nn.Module):
    """Attention within windows of one size, with a bias for each relative position."""

    def __init__(self, channels: int, heads: int, window: int):
        super().__init__()
        self.heads, self.window = heads, window
        self.qkv = nn.Linear(channels, 3 * channels)
        self.proj = nn.Linear(channels, channels)
        self.bias_table = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))

    def forward(self, x: torch.Tensor, shifted: bool) -> torch.Tensor:
        """x: [batch, y, x, channel]."""
        batch, rows, columns, channels = x.shape
        w = self.window
        x = F.pad(x, (0, 0, 0, -columns % w, 0, -rows % w))
        padded = x.shape[1:3]
        shift = [w // 2 if shifted and side > w else 0 for side in padded]
        x = torch.roll(x, (-shift[0], -shift[1]), (1, 2))
        # Where each token of the rolled map came from, to see whether two are neighbours in the map.
        origin_y = (torch.arange(padded[0]) + shift[0]) % padded[0]
        origin_x = (torch.arange(padded[1]) + shift[1]) % padded[1]
        out = torch.zeros_like(x)
        offsets = torch.arange(w)
        ty, tx = (t.flatten() for t in torch.meshgrid(offsets, offsets, indexing="ij"))
        table = self.bias_table.reshape(2 * w - 1, 2 * w - 1, self.heads)
        bias = table[ty[:, None] - ty[None] + w - 1, tx[:, None] - tx[None] + w - 1].permute(2, 0, 1)
        for y0 in range(0, padded[0], w):
            for x0 in range(0, padded[1], w):
                tokens = x[:, y0 : y0 + w, x0 : x0 + w].reshape(batch, w * w, channels)
                q, k, v = self.qkv(tokens).reshape(batch, w * w, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
                # Tokens that came round a border keep apart from those that did not.
                round_y = origin_y[y0 : y0 + w][ty] < shift[0]
                round_x = origin_x[x0 : x0 + w][tx] < shift[1]
                apart = (round_y[:, None] != round_y[None]) | (round_x[:, None] != round_x[None])
                scores = q @ k.transpose(-2, -1) / q.shape[-1] ** 0.5 + bias - 100.0 * apart
                seen = (scores.softmax(-1) @ v).transpose(1, 2).reshape(batch, w, w, channels)
                out[:, y0 : y0 + w, x0 : x0 + w] = self.proj(seen)
        return torch.roll(out, shift, (1, 2))[:, :rows, :columns]


class Block(nn.Module):
    """Attention and a feed-forward net behind layer norms."""

    def __init__(self, channels: int, heads: int, window: int, ratio: int, shifted: bool):
        super().__init__()
        self.shifted = shifted
        self.norm1 = nn.LayerNorm(channels)
        self.attention = Attention(channels, heads, window)
        self.norm2 = nn.LayerNorm(channels)
        self.mlp = nn.ModuleDict(
            {"hidden": nn.Linear(channels, ratio * channels), "out": nn.Linear(ratio * channels, channels)}
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x + self.attention(self.norm1(x), self.shifted)
        return x + self.mlp["out"](F.gelu(self.mlp["hidden"](self.norm2(x))))


class Merge(nn.Module):
    """Four neighbours to one token, in the order (y, x) = 00, 10, 01, 11."""

    def __init__(self, channels: int):
        super().__init__()
        self.norm = nn.LayerNorm(4 * channels)
        self.reduction = nn.Linear(4 * channels, 2 * channels, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = F.pad(x, (0, 0, 0, x.shape[2] % 2, 0, x.shape[1] % 2))
        four = [x[:, y::2, column::2] for y, column in [(0, 0), (1, 0), (0, 1), (1, 1)]]
        return self.reduction(self.norm(torch.cat(four, -1)))


class Stage(nn.Module):
    """Blocks, and the merging behind them."""

    def __init__(self, channels: int, depth: int, heads: int, window: int, ratio: int, last: bool):
        super().__init__()
        self.blocks = nn.ModuleList(
            Block(channels, heads, window, ratio, shifted=block % 2 == 1) for block in range(depth)
        )
        if not last:
            self.merge = Merge(channels)


class Swin(nn.Module):
    """The backbone: maps of the last three stages, each through a layer norm."""

    def __init__(self, embed: int, depths: list[int], heads: list[int], window: int, ratio: int):
        super().__init__()
        self.patch = nn.ModuleDict({"conv": nn.Conv2d(3, embed, 4, 4), "norm": nn.LayerNorm(embed)})
        self.stages = nn.ModuleList(
            Stage(embed * 2**i, depths[i], heads[i], window, ratio, last=i == 3) for i in range(4)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(embed * 2**i) for i in (1, 2, 3))

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        image = F.pad(image, (0, -image.shape[3] % 4, 0, -image.shape[2] % 4))
        x = self.patch["norm"](self.patch["conv"](image).permute(0, 2, 3, 1))
        maps = []
        for i, stage in enumerate(self.stages):
            for block in stage.blocks:
                x = block(x)
            if i > 0:
                maps.append(self.norms[i - 1](x).permute(0, 3, 1, 2))
            if i < 3:
                x = stage.merge(x)
        return maps


SMALL = {"embed": 4, "depths": [2, 2, 1, 1], "heads": [1, 2, 2, 4], "window": 3, "ratio": 2}
TINY = {"embed": 96, "depths": [2, 2, 6, 2], "heads": [3, 6, 12, 24], "window": 7, "ratio": 4}


def rename(state: dict, table: list[tuple[str, str]]) -> dict:
    """Keys with each text on the left of the table replaced, in order."""
    renamed = {}
    for key, value in state.items():
        for ours, theirs in table:
            key = key.replace(ours, theirs)
        renamed[key] = value.clone()
    return renamed


def microsoft(state: dict) -> dict:
    """Names of Microsoft: merging at the end of a stage, output norms numbered by stage."""
    table = [("patch.conv", "patch_embed.proj"), ("patch.norm", "patch_embed.norm"), ("attention.", "attn.")]
    table += [
        ("bias_table", "relative_position_bias_table"),
        ("mlp.hidden", "mlp.fc1"),
        ("mlp.out", "mlp.fc2"),
    ]
    table += [("merge.", "downsample."), ("norms.2.", "norm3."), ("norms.1.", "norm2.")]
    return rename(state, [*table, ("norms.0.", "norm1."), ("stages.", "layers.")])


def timm(state: dict) -> dict:
    """Names of timm: merging at the start of a stage, a classifier instead of output norms."""
    table = [(f"layers.{i}.downsample", f"layers.{i + 1}.downsample") for i in (2, 1, 0)]
    return rename({k: v for k, v in microsoft(state).items() if not k.startswith("norm")}, table)


def torchvision(state: dict) -> dict:
    """Names of torchvision: features counts stages and mergings in turn."""
    state = {k: v for k, v in microsoft(state).items() if not k.startswith("norm")}
    table = [("patch_embed.proj", "features.0.0"), ("patch_embed.norm", "features.0.2")]
    table += [(f"layers.{i}.blocks.", f"features.{2 * i + 1}.") for i in range(4)]
    table += [(f"layers.{i}.downsample.", f"features.{2 * i + 2}.") for i in range(3)]
    return rename(state, [*table, ("mlp.fc1", "mlp.0"), ("mlp.fc2", "mlp.3")])


def mmdet(state: dict) -> dict:
    """Names of mmdet, and its order of merged channels: torch's unfold, channel outermost, then rows."""
    table = [("patch_embed.proj", "patch_embed.projection"), ("layers.", "stages."), ("attn.", "attn.w_msa.")]
    table += [("mlp.fc1", "ffn.layers.0.0"), ("mlp.fc2", "ffn.layers.1")]
    state = rename(microsoft(state), table)
    for key in [key for key in state if "downsample" in key]:
        channels = state[key].shape[-1] // 4
        # What unfold makes of a map whose cells hold their index in our order says where each channel goes.
        index = torch.arange(4 * channels, dtype=torch.float64).reshape(2, 2, channels).permute(2, 1, 0)
        order = F.unfold(index[None], kernel_size=2, stride=2).flatten().long()
        state[key] = state[key][..., order].clone()
    return state


def with_classifier(state: dict, channels: int, head: str, buffers: bool) -> dict:
    """Adds the other tensors that a library keeps beside the backbone."""
    state = dict(state) | {"norm.weight": torch.ones(channels), "norm.bias": torch.zeros(channels)}
    state |= {f"{head}.weight": torch.zeros(5, channels), f"{head}.bias": torch.zeros(5)}
    if buffers:
        for key in [key for key in state if key.endswith("relative_position_bias_table")]:
            state[key.replace("bias_table", "index")] = torch.zeros(81, dtype=torch.int64)
    return state


def small() -> None:
    """Every output and gradient of the small net."""
    net = Swin(**SMALL)
    formula.fill(net)
    image = formula.tensor("image", (2, 3, 37, 50)).requires_grad_()
    maps = net(image)
    loss = sum((m * formula.tensor(f"d_map{i}", tuple(m.shape))).sum() for i, m in enumerate(maps))
    loss.backward()
    out = {f"map{i}": m.detach().contiguous() for i, m in enumerate(maps)}
    out |= {f"gradient.{name}": p.grad for name, p in net.named_parameters()}
    save_file(out | {"gradient.image": image.grad}, HERE / "swin.safetensors")

    state = net.state_dict()
    torch.save(
        {"model": with_classifier(torchvision(state), 32, "head", True)},
        HERE / "swin_weights_torchvision.pth",
    )
    save_file(with_classifier(timm(state), 32, "head.fc", False), HERE / "swin_weights_timm.safetensors")
    prefixed = {f"backbone.{key}": value for key, value in mmdet(state).items()}
    prefixed["neck.convs.0.weight"] = torch.zeros(3)
    torch.save({"meta": {"epoch": 1}, "state_dict": prefixed}, HERE / "swin_weights_mmdet.pth")
    torch.save(microsoft(state), HERE / "swin_weights_microsoft.pt")


def tiny() -> None:
    """Some outputs of Swin-T, at a size that no stage divides."""
    net = Swin(**TINY)
    formula.fill(net)
    with torch.no_grad():
        maps = net(formula.tensor("image", (1, 3, 122, 206)))
    # Every 37th value; 37 divides no channel count or map.
    save_file(
        {f"map{i}": m.flatten()[::37].contiguous() for i, m in enumerate(maps)}, HERE / "swin_t.safetensors"
    )
    print("Swin-T parameters:", sum(p.numel() for p in net.parameters()))


if __name__ == "__main__":
    torch.manual_seed(0)
    small()
    tiny()
