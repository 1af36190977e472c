"""The messages of Sparkplug B's payload, by the field numbers of its specification (3.0, 6.4).

Only what Abbe says and hears is here: no data sets, templates and files. A decoder by the whole
schema reads what is written by this part, and what it does not know is skipped, as protobuf has it.
"""

from __future__ import annotations

from typing import Any, Final

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

_PACKAGE = "org.eclipse.tahu.protobuf"
_KINDS: Final = {
    "uint32": descriptor_pb2.FieldDescriptorProto.TYPE_UINT32,
    "uint64": descriptor_pb2.FieldDescriptorProto.TYPE_UINT64,
    "float": descriptor_pb2.FieldDescriptorProto.TYPE_FLOAT,
    "double": descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE,
    "bool": descriptor_pb2.FieldDescriptorProto.TYPE_BOOL,
    "string": descriptor_pb2.FieldDescriptorProto.TYPE_STRING,
    "bytes": descriptor_pb2.FieldDescriptorProto.TYPE_BYTES,
}
_VALUES: Final = {
    "int_value": "uint32",
    "long_value": "uint64",
    "float_value": "float",
    "double_value": "double",
    "boolean_value": "bool",
    "string_value": "string",
}
"""Alternatives of a value, in the order of their numbers."""
_MESSAGES: Final[dict[str, list[tuple[int, str, str]]]] = {
    "Payload.PropertyValue": [(1, "type", "uint32"), (2, "is_null", "bool")],
    "Payload.PropertySet": [(1, "keys", "string*"), (2, "values", "Payload.PropertyValue*")],
    "Payload.Metric": [
        (1, "name", "string"),
        (2, "alias", "uint64"),
        (3, "timestamp", "uint64"),
        (4, "datatype", "uint32"),
        (5, "is_historical", "bool"),
        (6, "is_transient", "bool"),
        (7, "is_null", "bool"),
        (9, "properties", "Payload.PropertySet"),
    ],
    "Payload": [
        (1, "timestamp", "uint64"),
        (2, "metrics", "Payload.Metric*"),
        (3, "seq", "uint64"),
        (4, "uuid", "string"),
        (5, "body", "bytes"),
    ],
}
_FIRST_VALUE: Final = {"Payload.PropertyValue": 3, "Payload.Metric": 10}
"""Number of the first alternative of a value."""


def _payload_class() -> Any:
    file = descriptor_pb2.FileDescriptorProto(
        name="abbe/sparkplug_b.proto", package=_PACKAGE, syntax="proto2"
    )
    payload = file.message_type.add(name="Payload")
    for name, fields in _MESSAGES.items():
        inner = name.rpartition(".")[2]
        message = payload if inner == name else payload.nested_type.add(name=inner)
        for number, field, kind in fields:
            _add(message, number, field, kind)
        if name in _FIRST_VALUE:
            message.oneof_decl.add(name="value")
            for number, (field, kind) in enumerate(_VALUES.items(), _FIRST_VALUE[name]):
                _add(message, number, field, kind).oneof_index = 0
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.Payload"))


def _add(
    message: descriptor_pb2.DescriptorProto, number: int, name: str, kind: str
) -> descriptor_pb2.FieldDescriptorProto:
    field = message.field.add(name=name, number=number)
    repeated, plain = kind.endswith("*"), kind.removesuffix("*")
    field.label = field.LABEL_REPEATED if repeated else field.LABEL_OPTIONAL
    if plain in _KINDS:
        field.type = _KINDS[plain]
    else:
        field.type = field.TYPE_MESSAGE
        field.type_name = f".{_PACKAGE}.{plain}"
    return field


Payload: Final[Any] = _payload_class()
"""The class of a whole payload."""
