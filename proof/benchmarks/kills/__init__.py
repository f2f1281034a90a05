"""What a command leaves that is killed or interrupted at any moment: ``python -m benchmarks.kills -n 100 -o FILE.md``."""
