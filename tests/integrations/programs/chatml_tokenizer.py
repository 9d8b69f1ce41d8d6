"""Writes a tokenizer whose tokens are bytes, with a chat template that accepts tools, in the environment of Atropos.

chatml_tokenizer.py FOLDER
"""

import sys

from tokenizers import Tokenizer, decoders, models, pre_tokenizers
from transformers import PreTrainedTokenizerFast

TEMPLATE = """\
{% for tool in tools %}{{ tool | tojson }}
{% endfor %}{% for message in messages %}{% if message.role != "assistant" %}[{{ message.role }}] {{ message.content }}
[assistant] {% elif message.tool_calls %}{{ message.tool_calls[0].function | tojson }}
{% else %}{{ message.content }}
{% endif %}{% endfor %}"""
"""The mark `[assistant]` is part of the message before a reply, so the prompt needs no text that starts the reply."""


def main(folder: str) -> None:
    """Write the tokenizer."""
    marks = sorted(pre_tokenizers.ByteLevel.alphabet())
    # Each byte has a character: printable ones of Latin 1 are the same, the other bytes get characters from U+0100 on.
    plain = [*range(33, 127), *range(161, 173), *range(174, 256)]
    byte_of = {chr(byte): byte for byte in plain}
    byte_of |= {chr(256 + place): byte for place, byte in enumerate(sorted(set(range(256)) - set(plain)))}
    tokenizer = Tokenizer(models.BPE(vocab={mark: byte_of[mark] for mark in marks}, merges=[]))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False)
    tokenizer.decoder = decoders.ByteLevel()
    made = PreTrainedTokenizerFast(tokenizer_object=tokenizer)
    made.chat_template = TEMPLATE
    made.save_pretrained(folder)


main(sys.argv[1])
