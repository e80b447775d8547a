/* Plays a dump through fakenect and writes what it hands out: FAKENECT_PATH=DUMP fakenect_dump FRAMES.bin
 *
 * FRAMES.bin: per frame the device's stamp (uint32) and 640 x 480 codes (uint16), in this machine's order of bytes. */
#include <libfreenect.h>
#include <stdio.h>

enum { PIXELS = 640 * 480 };

static FILE *out;
static int failed;

static void depth(freenect_device *device, void *codes, uint32_t ticks)
{
    (void)device;
    if (fwrite(&ticks, sizeof ticks, 1, out) != 1 || fwrite(codes, sizeof(uint16_t), PIXELS, out) != PIXELS)
        failed = 1;
}

int main(int count, char **arguments)
{
    freenect_context *context;
    freenect_device *device;
    if (count != 2 || !(out = fopen(arguments[1], "wb")))
        return 2;
    if (freenect_init(&context, NULL) != 0 || freenect_open_device(context, &device, 0) != 0)
        return 3;
    freenect_set_depth_callback(device, depth);
    if (freenect_set_depth_mode(device, freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, FREENECT_DEPTH_11BIT)) != 0)
        return 4;
    if (freenect_start_depth(device) != 0)
        return 5;
    while (freenect_process_events(context) == 0) {
    }
    return fclose(out) != 0 || failed;
}
