"""Trains a tiny model for one step with TRL's own trainer on the laboratory, in the environment of TRL.

trl_step.py MODEL BACKEND GENERATIONS BUDGET ROW...    prints a line of JSON; a row of the dataset is JSON, too

MODEL is a GGUF file, whose weights transformers dequantises, or `random`, or an address. With the last two, the model
is tiny and has random weights. With `random` it samples its replies. With an address, the server there supplies the
replies of the first half of each group, and the second half answers 0 in its first reply. TRL does everything else:
prompts, parsing, tool calls, rewards, advantages, and the step of the optimiser.
"""

import json
import resource
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
import trl
from datasets import Dataset
from physment_trl import PhysMent, rows
from physment_trl.in_process import InProcessPhysMent
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import (
    AutoModelForCausalLM,
    AutoTokenizer,
    GgufConfig,
    PreTrainedTokenizerFast,
    Qwen3Config,
    Qwen3ForCausalLM,
)
from trl import GRPOConfig, GRPOTrainer

MARKS = ["<|endoftext|>", "<|im_start|>", "<|im_end|>"]
TEMPLATE = (Path(trl.__file__).parent / "chat_templates" / "qwen3.jinja").read_text("utf-8")
"""TRL's copy of the chat template of Qwen 3. It contains the tools, and delimits messages as ChatML does."""
ENVIRONMENTS = {"referee": PhysMent, "process": InProcessPhysMent}
LONGEST = 16384
"""Tokens of a prompt with its completion; the descriptions of the tools and the prompt take about 6,000."""
REPLIES = {True: 150, False: 32}
"""Largest number of tokens that a pretrained model, or a tiny one with random weights, samples in an episode."""


def tokenizer_of(text: str) -> Any:
    """A byte-level tokenizer made from the text that it will read."""
    made = Tokenizer(models.BPE())
    made.pre_tokenizer, made.decoder = pre_tokenizers.ByteLevel(add_prefix_space=False), decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    made.train_from_iterator(
        [text], trainers.BpeTrainer(vocab_size=1500, special_tokens=MARKS, initial_alphabet=alphabet)
    )
    tokenizer = PreTrainedTokenizerFast(tokenizer_object=made, eos_token=MARKS[2], pad_token=MARKS[0])
    tokenizer.chat_template = TEMPLATE
    return tokenizer


class ScriptedModel(Qwen3ForCausalLM):
    """A model whose samples come from a script; probabilities and gradients come from its weights."""

    tokenizer: Any
    server: str
    generations: int

    def generate(self, input_ids: Any, attention_mask: Any, **_options: Any) -> Any:
        """Append the scripted reply to each conversation."""
        said = []
        for ids, mask in zip(input_ids, attention_mask, strict=True):
            text = self.tokenizer.decode(ids[mask.bool()], skip_special_tokens=False)
            said.append(torch.tensor(self.tokenizer.encode(self.reply(text) + MARKS[2])))
        width = max(map(len, said))
        padded = [torch.cat([ids, torch.full((width - len(ids),), self.tokenizer.pad_token_id)]) for ids in said]
        return torch.cat([input_ids, torch.stack(padded)], dim=1)

    def reply(self, text: str) -> str:
        """Ask the scripted model for the next reply in a conversation, and return its text."""
        first, *turns = [part.partition("\n") for part in text.split(MARKS[1])[2:]]
        contents = [(role, content.removesuffix("\n").removesuffix(MARKS[2])) for role, _, content in [first, *turns]]
        replies = [content for role, content in contents[:-1] if role == "assistant"]
        if replies and '"answer"' in replies[-1]:
            return "Done."
        if self.lazy(replies):
            return '<tool_call>\n{"name": "answer", "arguments": {"answer": 0}}\n</tool_call>'
        messages = [
            {"role": role, "content": content}
            if role == "assistant"
            else {
                "role": "user",
                "content": content.removeprefix("<tool_response>\n").removesuffix("\n</tool_response>"),
            }
            for role, content in contents[:-1]
        ]
        body = json.dumps({"model": "scripted", "messages": messages}).encode()
        request = urllib.request.Request(f"{self.server}/v1/chat/completions", body)
        with urllib.request.urlopen(request) as reply:
            message = json.loads(reply.read())["choices"][0]["message"]
        if not message.get("tool_calls"):
            return message["content"]
        function = message["tool_calls"][0]["function"]
        return f'<tool_call>\n{{"name": "{function["name"]}", "arguments": {function["arguments"]}}}\n</tool_call>'

    def lazy(self, replies: list[str]) -> bool:
        """Whether a conversation without a reply belongs to the half of its group that answers 0 at once."""
        if replies:
            return False
        self.begun = getattr(self, "begun", -1) + 1
        return self.begun % self.generations >= self.generations // 2


class TimedTrainer(GRPOTrainer):
    """A trainer that adds up the processor time of the phases of a step [s]."""

    def _timed(self, phase: str, work: Callable[[], Any]) -> Any:
        begun = time.process_time()
        try:
            return work()
        finally:
            phases = self.__dict__.setdefault("phases", Counter())
            phases[phase] += time.process_time() - begun

    def _generate_single_turn(self, *args: Any, **named: Any) -> Any:
        return self._timed("generate", lambda: super(TimedTrainer, self)._generate_single_turn(*args, **named))

    def _prepare_inputs(self, *args: Any, **named: Any) -> Any:
        return self._timed("prepare", lambda: super(TimedTrainer, self)._prepare_inputs(*args, **named))

    def compute_loss(self, *args: Any, **named: Any) -> Any:
        return self._timed("forward", lambda: super(TimedTrainer, self).compute_loss(*args, **named))

    def training_step(self, *args: Any, **named: Any) -> Any:
        return self._timed("step", lambda: super(TimedTrainer, self).training_step(*args, **named))

    def spent(self, total: float) -> dict[str, float]:
        """Return the processor time of each phase; `total` is that of the whole training."""
        found = self.phases
        return {
            "generate_s": found["generate"],
            "tools_and_rewards_s": found["prepare"] - found["generate"],
            "forward_s": found["forward"],
            "backward_s": found["step"] - found["prepare"] - found["forward"],
            "others_s": total - found["step"],
        }


def tiny(tokenizer: Any, server: str, generations: int) -> Any:
    """A model of two layers with random weights."""
    config = Qwen3Config(
        vocab_size=len(tokenizer), hidden_size=32, intermediate_size=64, num_hidden_layers=2, num_attention_heads=2,
        num_key_value_heads=1, head_dim=16, max_position_embeddings=LONGEST, pad_token_id=tokenizer.pad_token_id,
        eos_token_id=tokenizer.eos_token_id, bos_token_id=None,
    )  # fmt: skip
    if server == "random":
        return Qwen3ForCausalLM(config)
    model = ScriptedModel(config)
    model.tokenizer, model.server, model.generations = tokenizer, server, generations
    return model


def pretrained(file: Path) -> tuple[Any, Any]:
    """The model and the tokenizer of a GGUF file; the weights become floats of 32 bits.

    Without `dequantize`, transformers keeps most weights quantised, and refuses to train them.
    """
    model = AutoModelForCausalLM.from_pretrained(
        file.parent, gguf_file=file.name, dtype=torch.float32, quantization_config=GgufConfig(dequantize=True)
    )
    tokenizer = AutoTokenizer.from_pretrained(file.parent, gguf_file=file.name)
    tokenizer.chat_template = TEMPLATE
    return model, tokenizer


def main(server: str, backend: str, generations: str, budget: str, *variants: str) -> None:
    """Train for one step, and print what the trainer logged, the conversations, and whether the weights changed."""
    count, environment = int(generations), ENVIRONMENTS[backend]
    named = [json.loads(row) for row in variants]
    (blank,) = rows(scenes="7")
    dataset = Dataset.from_list([{"prompt": blank["prompt"], "budget": int(budget), **row} for row in named])
    torch.manual_seed(1)
    begun, is_pretrained = time.process_time(), server.endswith(".gguf")
    if is_pretrained:
        model, tokenizer = pretrained(Path(server))
    else:
        tokenizer = tokenizer_of(probe(environment, named[0]))
        model = tiny(tokenizer, server, count)
    loaded_s = time.process_time() - begun
    scripted = isinstance(model, ScriptedModel)
    before = [weight.detach().clone() for weight in model.parameters()]
    with tempfile.TemporaryDirectory() as folder:
        arguments = GRPOConfig(
            output_dir=folder, max_steps=1, num_generations=count, per_device_train_batch_size=count * len(named),
            max_completion_length=LONGEST // 2 if scripted else REPLIES[is_pretrained],
            max_tool_calling_iterations=int(budget),
            learning_rate=1e-3, logging_steps=1, report_to="none", use_cpu=True, bf16=False, save_strategy="no",
            shuffle_dataset=False, disable_tqdm=True, log_completions=False,
        )  # fmt: skip
        trainer = TimedTrainer(
            model, args=arguments, train_dataset=dataset, processing_class=tokenizer, environment_factory=environment
        )
        begun, clock = time.process_time(), time.monotonic()
        trainer.train()
        spent = {"cpu_s": time.process_time() - begun, "wall_s": time.monotonic() - clock, "load_s": loaded_s}
        spent |= trainer.spent(spent["cpu_s"])
    logged = next(entry for entry in trainer.state.log_history if "reward" in entry)
    changed = any(not torch.equal(old, new) for old, new in zip(before, model.parameters(), strict=True))
    again = [one.get_reward() for one in trainer.environments]
    spent["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    print(json.dumps({"log": logged, "rewards": again, "changed": changed, **spent}))


def probe(environment: Any, variant: dict[str, Any]) -> str:
    """Return a prompt; the vocabulary of the small tokenizer consists of its words."""
    opened = environment()
    text = opened.reset(**variant)
    opened._leave()
    return text


main(*sys.argv[1:])
