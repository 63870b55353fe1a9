"""What is to be computed: scenario text, checked, becomes a frozen model of physics. Nothing here is compiled."""
