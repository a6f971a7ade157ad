"""The inside of a functional mock-up unit: what an importer calls, in the subset of Python that becomes machine code and C."""
