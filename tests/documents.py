"""Code in the documents, to be run."""

import re


def code_blocks(text, language="python"):
    """Blocks of a language in a Markdown text, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def run_blocks(blocks, names=None):
    """Run blocks one after the other with the same names; return these."""
    names = {"__name__": "document"} if names is None else names
    for block in blocks:
        exec(compile(block, block.splitlines()[0], "exec"), names)
    return names
