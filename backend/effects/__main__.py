"""Write the effects' declarations where the reader of drawings finds them: python -m backend.effects."""

import json
from pathlib import Path

import backend.mechanism
from backend.effects.catalogue import vocabulary

VOCABULARY = Path(backend.mechanism.__file__).with_name("effect_kinds.json")

if __name__ == "__main__":
    VOCABULARY.write_text(json.dumps(vocabulary(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
