"""Fitting a small network to pairs."""

import torch

from lacoloco.pipelines.learn import regression


def test_it_finds_a_smooth_function(monkeypatch):
    monkeypatch.setattr(regression, "STEPS", 400)
    generator = torch.Generator().manual_seed(0)
    torch.manual_seed(0)
    inputs = 3.0 * torch.rand(2000, 2, generator=generator) + 100.0
    outputs = torch.stack((inputs[:, 0].sin(), inputs[:, 1].cos()), dim=1)
    predict = regression.fit_regression(inputs[:1500], outputs[:1500], generator)
    error = (predict(inputs[1500:]) - outputs[1500:]).square().mean().sqrt()
    assert error < 0.2 < outputs.std()
