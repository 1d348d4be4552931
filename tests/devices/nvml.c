/* A stand-in for NVIDIA's libnvidia-ml.so.1, for tests: as many GPUs as SHIM_DEVICES has ordinals of CUDA's, each with
   100 MiB in use and 64 MiB more for each context of a process that still runs, by the lines of SHIM_CONTEXTS (egl.c). */

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct { unsigned long long total, free, used; } Memory;
enum { DONE = 0, INVALID = 2 };

int nvmlInit_v2(void) { return DONE; }
int nvmlShutdown(void) { return DONE; }

int nvmlDeviceGetCount_v2(unsigned *count) {
  const char *at = getenv("SHIM_DEVICES");
  *count = 0;
  for (; at && *at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) *count += *at != '-';
  return DONE;
}

int nvmlDeviceGetHandleByIndex_v2(unsigned index, void **device) {
  unsigned count;
  nvmlDeviceGetCount_v2(&count);
  *device = (void *)(unsigned long)(index + 1);
  return index < count ? DONE : INVALID;
}

int nvmlDeviceGetName(void *device, char *name, unsigned length) {
  snprintf(name, length, "Stand-in %lu", (unsigned long)device - 1);
  return DONE;
}

int nvmlDeviceGetMemoryInfo(void *device, Memory *memory) {
  FILE *file = getenv("SHIM_CONTEXTS") ? fopen(getenv("SHIM_CONTEXTS"), "r") : NULL;
  int ordinal, pid;
  memory->total = 8ULL << 30;
  memory->used = 100ULL << 20;
  while (file && fscanf(file, "%d %d", &ordinal, &pid) == 2)
    if (ordinal == (int)(unsigned long)device - 1 && kill(pid, 0) == 0) memory->used += 64ULL << 20;
  if (file) fclose(file);
  memory->free = memory->total - memory->used;
  return DONE;
}
