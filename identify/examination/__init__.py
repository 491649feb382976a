"""An accepted answer under examination: other valleys, events it hangs on, finer steps, and how sure it is."""
