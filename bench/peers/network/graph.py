"""The bird's-eye part as an ONNX graph, from its layers in PyTorch."""

import onnx
from onnx import TensorProto, helper, numpy_helper
from torch import nn


def bytes_of(part, rows=200, columns=176):
    nodes, weights = [], []

    def weight(name, tensor):
        weights.append(numpy_helper.from_array(tensor.detach().numpy(), name))
        return name

    def chain(layers, value, prefix):
        for number, layer in enumerate(layers):
            name = f"{prefix}.{number}"
            if isinstance(layer, nn.ReLU):
                nodes.append(helper.make_node("Relu", [value], [name]))
            else:
                inputs = [value, weight(f"{name}.weight", layer.weight), weight(f"{name}.bias", layer.bias)]
                attributes = {"strides": list(layer.stride)}
                if isinstance(layer, nn.ConvTranspose2d):
                    nodes.append(helper.make_node("ConvTranspose", inputs, [name], **attributes))
                else:
                    pads = list(layer.padding) * 2
                    nodes.append(helper.make_node("Conv", inputs, [name], pads=pads, **attributes))
            value = name
        return value

    first = chain(part.blocks[0], "bev", "block1")
    second = chain(part.blocks[1], first, "block2")
    ups = [chain(part.deblocks[0], first, "up1"), chain(part.deblocks[1], second, "up2")]
    nodes.append(helper.make_node("Concat", ups, ["features"], axis=1))
    graph = helper.make_graph(
        nodes,
        "second",
        [helper.make_tensor_value_info("bev", TensorProto.FLOAT, [1, 256, rows, columns])],
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, [1, 512, rows, columns])],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)
    onnx.checker.check_model(model)
    return model.SerializeToString()
