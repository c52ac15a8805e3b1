"""The examples of `omnisight demo`."""
