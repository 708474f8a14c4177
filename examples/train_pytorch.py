"""Trains a small PyTorch network to say, from the LiDAR cloud alone, whether anything harms: a loop of thirty lines.

harmzone gen --out data --preset demo --set val_every=0 && harmzone label data
python examples/train_pytorch.py data
"""

import sys

import torch
from torch import nn
from torch.utils.data import DataLoader

import harmzone


class Cloud(nn.Module):
    """PointNet in small: features of each point and the state, the greatest over the cloud, one logit."""

    def __init__(self) -> None:
        super().__init__()
        self.of_point = nn.Sequential(nn.Linear(6, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU())
        self.of_cloud = nn.Linear(64, 1)

    def forward(self, points: list[torch.Tensor], states: torch.Tensor) -> torch.Tensor:
        """Logits (B,) of clouds (N, 5) and states (B, 2)."""
        scale = torch.tensor([20.0, 10.0, 2.0, 255.0])
        inputs = [
            torch.cat([p[:, :4] / scale, s.expand(len(p), 2)], 1) for p, s in zip(points, states, strict=True)
        ]
        return self.of_cloud(torch.stack([self.of_point(each).amax(0) for each in inputs])).squeeze(1)


def train(data: str, epochs: int = 3) -> list[float]:
    """Trains on a labelled data set; returns the mean loss of each epoch."""
    torch.manual_seed(0)
    samples = harmzone.Dataset(data, labels="rect")
    loader = DataLoader(samples, batch_size=4, shuffle=True, collate_fn=harmzone.collate)
    network, losses = Cloud(), []
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3)
    for _ in range(epochs):
        of_epoch = []
        for batch in loader:
            harms = torch.tensor([float(harmful.any()) for harmful in batch["harmful"]])
            logits = network(batch["points"], batch["state"])
            loss = nn.functional.binary_cross_entropy_with_logits(logits, harms)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            of_epoch.append(loss.item())
        losses.append(sum(of_epoch) / len(of_epoch))
    return losses


if __name__ == "__main__":
    print(train(sys.argv[1]))
