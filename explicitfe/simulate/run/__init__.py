"""What a command does: scenario in, result out; one file a kind of analysis."""
