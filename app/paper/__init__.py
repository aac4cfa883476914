"""The paper's tables and figures, and studies beyond them, from real runs: what ``python -m app.reproduce`` does."""
