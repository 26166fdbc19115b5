"""A dense network for prediction: the same function with fewer operations, whatever its layers are.

Batch norm becomes part of the dense layer before it, dropout goes, and each dense layer is one product with weights
laid out for it. Layers of other kinds, additions and so on stay as they are. The layers are found by `torch.fx`.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import torch
from torch import fx, nn

__all__ = ["fold"]


def fold(model: nn.Module) -> Callable[[torch.Tensor], Any]:
    """The same function as `model` in evaluation, but for rounding; on its device, no gradients.

    The model's batch norms follow dense layers of vectors (B, channels). A model that torch.fx cannot trace, because
    what it does depends on its input, comes back as it is.
    """
    plain = deepcopy(model).eval()
    try:
        traced = fx.symbolic_trace(plain)
    except (fx.proxy.TraceError, TypeError, RuntimeError):  # what a use of values that are not there yet ends in
        return plain
    modules = dict(traced.named_modules())
    for node in list(traced.graph.nodes):
        if node.op != "call_module":
            continue
        module, (source, *_) = modules[node.target], node.args
        if isinstance(module, nn.Dropout | nn.Identity):
            _replace(node, source)
        elif isinstance(module, nn.BatchNorm1d) and _is_its_own(source, modules):
            modules[source.target] = nn.utils.fuse_linear_bn_eval(modules[source.target], module)
            _replace(node, source)
    for node in list(traced.graph.nodes):
        if node.op == "call_module" and isinstance(modules[node.target], nn.Linear | nn.ReLU):
            _as_function(node, modules[node.target], traced)
    traced.delete_all_unused_submodules()
    traced.recompile()
    return torch.no_grad()(traced.forward)


def _product(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    return torch.addmm(bias, x, weight) if x.ndim == 2 else x @ weight + bias


def _is_its_own(node: fx.Node, modules: dict[str, nn.Module]) -> bool:
    """Whether it is a dense layer that is used once, and whose output is used once."""
    if node.op != "call_module" or not isinstance(modules[str(node.target)], nn.Linear):
        return False
    return len(node.users) == 1 and sum(other.target == node.target for other in node.graph.nodes) == 1


def _replace(node: fx.Node, other: fx.Node) -> None:
    node.replace_all_uses_with(other)
    node.graph.erase_node(node)


def _as_function(node: fx.Node, module: nn.Module, traced: fx.GraphModule) -> None:
    (source,) = node.args
    with node.graph.inserting_before(node):
        if isinstance(module, nn.Linear):
            name = str(node.target).replace(".", "_")
            no_bias = module.weight.new_zeros(module.out_features)
            traced.register_buffer(f"{name}_weight", module.weight.detach().T.contiguous())
            traced.register_buffer(f"{name}_bias", no_bias if module.bias is None else module.bias.detach())
            weight, bias = node.graph.get_attr(f"{name}_weight"), node.graph.get_attr(f"{name}_bias")
            _replace(node, node.graph.call_function(_product, (source, weight, bias)))
        else:
            _replace(node, node.graph.call_function(torch.relu, (source,)))
