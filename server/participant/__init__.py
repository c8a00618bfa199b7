"""What participants do on their own machine: begin, check, try and submit."""
