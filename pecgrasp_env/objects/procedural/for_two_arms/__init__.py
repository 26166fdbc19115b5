"""Long and heavy things that one hand does not carry: boards, open crates, tools with long handles."""
