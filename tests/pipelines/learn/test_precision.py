import pytest
import torch

from lacoloco.pipelines.learn.precision import fast_products, has_bf16_matrix_units


@pytest.mark.parametrize(("amx", "dtype"), [(True, torch.bfloat16), (False, torch.float32)])
def test_layers_multiply_in_half_the_bits_only_with_matrix_units(monkeypatch, amx, dtype):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": amx})
    assert has_bf16_matrix_units(torch.device("cpu")) is amx
    with fast_products(torch.device("cpu")):
        assert torch.nn.Linear(3, 2)(torch.ones(1, 3)).dtype is dtype


def test_a_gpu_is_left_as_it_is(monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True})
    assert not has_bf16_matrix_units(torch.device("cuda"))
