"""The paper's closed forms: ageing, one slip, one cycle, steady sliding, and where they change their answer."""
