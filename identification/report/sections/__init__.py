"""The parts of a report in the order of its pages, one module a part; each makes blocks, no markup."""
