"""The paper's tables and figures from real runs."""
