"""The paper's parameter studies: what is run, what comes out, and what that says of the paper's claims."""
