"""The layers below the stages and above them; see docs/architecture.md."""
