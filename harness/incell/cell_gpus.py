"""List the devices that CUDA and Vulkan see, each in its own order; this file, run by itself, asks one of the two.

A driver is asked in a process of its own: one that was asked here would be started before the library under test.
"""

SECONDS = 60
UUID = 16
NAME = 256
SUCCESS, INCOMPLETE, NO_DEVICE = 0, 5, 100
INSTANCE_CREATE, PROPERTIES_2, ID_PROPERTIES = 1, 1000059001, 1000071004
"""Vulkan's names of structures (VkStructureType)."""

VULKAN_1_1 = (1 << 22) | (1 << 12)
AFTER_NAME = 824 - 20 - NAME
"""Bytes of VkPhysicalDeviceProperties after the name: it takes 824, five numbers stand before the name."""

KINDS = ("other", "integrated", "discrete", "virtual", "software")


def list_devices(driver):
    """Ask `cuda` or `vulkan` for its devices: `name`, `uuid` and, for Vulkan, `kind`; None where it cannot answer.

    Without the library of the driver there are no devices.
    """
    import json
    import subprocess
    import sys

    command = [sys.executable, "-I", "-S", __file__, driver]
    try:
        output = subprocess.check_output(command, stderr=subprocess.DEVNULL, timeout=SECONDS)
        return json.loads(output.decode("utf-8"))
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


def cuda(ctypes):
    """Ask CUDA's driver. None where it answers with an error."""
    driver = ctypes.CDLL("libcuda.so.1")
    count, device = ctypes.c_int(), ctypes.c_int()
    name, uuid = ctypes.create_string_buffer(NAME), ctypes.create_string_buffer(UUID)
    began = driver.cuInit(0)
    if began == NO_DEVICE:
        return []
    if began or driver.cuDeviceGetCount(ctypes.byref(count)):
        return None
    devices = []
    for ordinal in range(count.value):
        if driver.cuDeviceGet(ctypes.byref(device), ordinal) or driver.cuDeviceGetName(name, NAME, device):
            return None
        has_uuid = driver.cuDeviceGetUuid(uuid, device) == SUCCESS
        devices.append({"name": text(name.value), "uuid": uuid.raw.hex() if has_uuid else ""})
    return devices


def vulkan(ctypes):
    """Ask Vulkan's loader, through which all drivers answer. None where it answers with an error."""
    loader = ctypes.CDLL("libvulkan.so.1")
    instance = create_instance(ctypes, loader)
    count = ctypes.c_uint32()
    if not instance or loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None) != SUCCESS:
        return None
    handles = (ctypes.c_void_p * count.value)()
    if loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles) not in (SUCCESS, INCOMPLETE):
        return None
    return [device_properties(ctypes, loader, handle) for handle in handles[: count.value]]


def create_instance(ctypes, loader):
    """Make an instance of Vulkan 1.1, the first that gives the UUID of a device."""

    class Application(ctypes.Structure):
        _fields_ = (
            ("type", ctypes.c_int),
            ("next", ctypes.c_void_p),
            ("name", ctypes.c_char_p),
            ("version", ctypes.c_uint32),
            ("engine", ctypes.c_char_p),
            ("engine_version", ctypes.c_uint32),
            ("api", ctypes.c_uint32),
        )

    class Creation(ctypes.Structure):
        _fields_ = (
            ("type", ctypes.c_int),
            ("next", ctypes.c_void_p),
            ("flags", ctypes.c_uint32),
            ("application", ctypes.POINTER(Application)),
            ("layer_count", ctypes.c_uint32),
            ("layers", ctypes.c_void_p),
            ("extension_count", ctypes.c_uint32),
            ("extensions", ctypes.c_void_p),
        )

    application = Application(api=VULKAN_1_1)
    creation = Creation(type=INSTANCE_CREATE, application=ctypes.pointer(application))
    instance = ctypes.c_void_p()
    error = loader.vkCreateInstance(ctypes.byref(creation), None, ctypes.byref(instance))
    return None if error else instance


def device_properties(ctypes, loader, handle):
    """Return name, UUID and kind of a physical device of Vulkan."""

    class Identity(ctypes.Structure):
        _fields_ = (
            ("type", ctypes.c_int),
            ("next", ctypes.c_void_p),
            ("uuid", ctypes.c_uint8 * UUID),
            ("driver", ctypes.c_uint8 * UUID),
            ("luid", ctypes.c_uint8 * 8),
            ("mask", ctypes.c_uint32),
            ("luid_valid", ctypes.c_uint32),
        )

    class Properties(ctypes.Structure):
        _fields_ = (
            ("type", ctypes.c_int),
            ("next", ctypes.c_void_p),
            ("api", ctypes.c_uint32),
            ("version", ctypes.c_uint32),
            ("vendor", ctypes.c_uint32),
            ("device", ctypes.c_uint32),
            ("kind", ctypes.c_uint32),
            ("name", ctypes.c_char * NAME),
            ("rest", ctypes.c_uint8 * AFTER_NAME),
        )

    identity = Identity(type=ID_PROPERTIES)
    answer = Properties(type=PROPERTIES_2, next=ctypes.cast(ctypes.pointer(identity), ctypes.c_void_p))
    loader.vkGetPhysicalDeviceProperties2.restype = None
    loader.vkGetPhysicalDeviceProperties2(ctypes.c_void_p(handle), ctypes.byref(answer))
    kind = KINDS[answer.kind] if answer.kind < len(KINDS) else KINDS[0]
    return {"name": text(answer.name), "uuid": bytes(identity.uuid).hex(), "kind": kind}


def text(raw):
    """Return a driver's bytes as text."""
    return raw.decode("utf-8", "replace")


def main(driver):
    """Print the devices of one of the two, as JSON."""
    import ctypes
    import json

    try:
        devices = {"cuda": cuda, "vulkan": vulkan}[driver](ctypes)
    except OSError:  # no such library
        devices = []
    print(json.dumps(devices))


if __name__ == "__main__":
    import sys

    main(sys.argv[1])
