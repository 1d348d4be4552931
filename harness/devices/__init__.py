"""Tell which device each library draws on, and why: rules of releases as pure functions, and advice."""
