"""JSON schemas: one for each document, which refuses what the document does not hold.

That documents of the commands suit them is tested wherever tests/replay writes one (`json_as_its_schema_says`).
"""

import jsonschema
import pytest

from scripts.json_documents import schema, schemas
from wrenchgap.replay.present.documents import VERSIONS, document

REMOVED = document("remove", {"removed": ["wind"], "effects": [], "model": "a.toml", "model_version": 3})


def test_every_document_has_a_schema_of_its_version():
    assert schemas().keys() == VERSIONS.keys()
    for command, found in schemas().items():
        jsonschema.Draft202012Validator.check_schema(found)
        assert found["properties"]["schema"]["const"] == f"wrenchgap.{command}/{VERSIONS[command]}"


@pytest.mark.parametrize("wrong", [{"model": 3}, {"removed": "wind"}, {"schema": "wrenchgap.add/1"}])
def test_a_wrong_type_is_refused(wrong):
    jsonschema.validate(REMOVED, schema("remove"))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(REMOVED | wrong, schema("remove"))


def test_a_key_that_is_not_listed_is_refused_by_the_strict_schema_alone():
    longer = REMOVED | {"another": 1}
    jsonschema.validate(longer, schema("remove"))
    with pytest.raises(jsonschema.ValidationError, match="another"):
        jsonschema.validate(longer, schema("remove", strict=True))
    without = {key: value for key, value in REMOVED.items() if key != "model"}
    with pytest.raises(jsonschema.ValidationError, match="model"):
        jsonschema.validate(without, schema("remove"))


def test_words_below_a_key_describe_it_wherever_it_is_inherited():
    found = schema("explain")
    assert found["properties"]["notes"]["description"].startswith("Sentences that a user should read")
    assert found["properties"]["left"]["description"] == "The residual."
    assert found["$defs"]["Validation"]["properties"]["by_flight"]["description"] == "What `--by-flight` prints."
